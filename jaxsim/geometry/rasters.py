"""Rasters of a camera: what they can be, whoever gives them; and the pixel nearest to each of which something is known.

`python benchmarks/speed/rasters.py`: of a view of 1242 x 375 in host memory one core looks at shapes and types in 7 us
(`check_shapes`), at values too in 0.2 ms (`check_rasters`).
"""

from __future__ import annotations

import warnings
from typing import Any

import cv2
import jax
import numpy as np
from jax.core import Tracer
from jaxtyping import Bool, Float, Int

from jaxsim.frame import CLASSES, CameraFrame

NEAR_M, FAR_M = 0.1, 200.0
"""Between these lies the nearest tenth of what a camera sees. A car's sees the road or a room's floor, and no LiDAR of
a car reaches farther: outside of them depth is in another unit. The far plane and the sky do not count, whatever a
renderer has there, for half of an image may be sky."""
UNIT_M = 1.0
"""Where nothing lies farther, depth was normalised to 0..1 or is an inverse."""
STRIDE = 8
"""Every so many pixels, in rows and columns, are enough to tell a unit."""


def check_shapes(view: CameraFrame, where: str) -> None:
    """Checks shapes and types alone of a view's rasters, or of a batch's, traced ones too; `where` begins the errors.

    Raises ValueError where the image is not (h, w, 3) of 8 bits, depth and labels are not (h, w) of the same size, or
    are of another kind: depth is real numbers, its mask true or false, labels are whole numbers; where there is no
    pixel, as `check_array`, and for what is no view.
    """
    if not isinstance(view, CameraFrame):
        raise ValueError(f"{where}: {type(view).__name__} came; give a CameraFrame, with rgb, camera and depth_m")
    for name in ("rgb", "depth_m", "depth_valid", "semantic", "instance"):
        check_array(getattr(view, name), f"{where}: {name}")
    rgb = np.shape(view.rgb)
    if len(rgb) < 3 or rgb[-1] != 3:
        raise ValueError(f"{where}: rgb is {rgb}; {_mend_image(rgb)}")
    if 0 in rgb:
        raise ValueError(f"{where}: rgb is {rgb}, without a pixel; give one view or more")
    kind = _kind(view.rgb)
    if kind != np.uint8:
        raise ValueError(
            f"{where}: rgb holds {kind}; it must be uint8, 0..255: multiply 0..1 by 255, divide 16 bits by 256, and "
            "take .astype(np.uint8)"
        )
    size = rgb[:-1]
    for name in ("depth_m", "depth_valid", "semantic", "instance"):
        raster = getattr(view, name)
        if raster is None:
            continue
        shape = np.shape(raster)
        if shape != size:
            raise ValueError(f"{where}: {name} is {shape}, rgb {rgb}; {_mend(name, shape, size)}")
        kind, (kinds, wanted) = _kind(raster), _KINDS[name]
        # Eight bits of depth are a picture of it.
        if kind.kind not in kinds or (name == "depth_m" and kind == np.uint8):
            raise ValueError(f"{where}: {name} holds {kind}; {wanted}")


def check_array(raster: Any, what: str) -> None:
    """Raises ValueError, beginning with `what`, for arrays that a compiled program would read as others: masked ones,
    which lose their mask, and those whose bytes are in the order of another machine."""
    if isinstance(raster, np.ma.MaskedArray):
        raise ValueError(
            f"{what} is a masked array, and its mask would be lost; give {what.split()[-1]}.filled(0), with 0 where "
            "there is nothing"
        )
    if isinstance(raster, np.ndarray) and not raster.dtype.isnative:
        raise ValueError(
            f"{what} holds {raster.dtype.str}, bytes in the order of another machine; take "
            ".astype(array.dtype.newbyteorder('='))"
        )


def check_rasters(view: CameraFrame, where: str, *, may_be_empty: bool = False) -> None:
    """Checks a view's rasters, or a batch's: shapes and types, and values where these are known (not while JAX traces).

    Raises ValueError as `check_shapes`, and where classes are no Cityscapes ids, where depth is negative, known in no
    pixel (unless the view `may_be_empty`, as one of a loop), or of a scale that is not metres. Warns of an image of 0
    and 1 alone.
    """
    check_shapes(view, where)
    if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(view)):
        return
    if np.asarray(view.rgb).max(initial=0) == 1:
        # No error, for a camera may see hardly any light.
        warnings.warn(
            f"{where}: rgb spans 0..1 of 0..255, which is black; multiply 0..1 by 255 before it becomes uint8",
            stacklevel=3,
        )
    if view.semantic is not None:
        check_classes(np.asarray(view.semantic), where)
    if view.instance is not None:
        check_instances(np.asarray(view.instance), where)
    if view.depth_m is not None:
        valid = None if view.depth_valid is None else np.asarray(view.depth_valid)
        _check_depth(np.asarray(view.depth_m), valid, where, may_be_empty=may_be_empty)


def on_host(view: CameraFrame) -> bool:
    """Whether all of a view's rasters can be read without a copy from an accelerator."""
    leaves = [leaf for leaf in jax.tree.leaves(view) if isinstance(leaf, jax.Array) and not isinstance(leaf, Tracer)]
    return all(device.platform == "cpu" for leaf in leaves for device in leaf.devices())


def check_classes(semantic: np.ndarray, where: str) -> None:
    """Raises ValueError, beginning with `where`, for classes that are no Cityscapes ids."""
    if not all_within(semantic, 0, CLASSES - 1):
        raise ValueError(
            f"{where}: semantic spans {span_in_words(semantic)}; it must hold Cityscapes ids 0..{CLASSES - 1}, 0 where "
            "the class is not known"
        )


def check_instances(instance: np.ndarray, where: str) -> None:
    """Raises ValueError, beginning with `where`, for objects' numbers of more than 32 bits: two of them would become
    one."""
    most = np.iinfo(np.int32).max
    if instance.dtype.itemsize >= 4 and not all_within(instance, -most - 1, most):
        raise ValueError(
            f"{where}: instance spans {span_in_words(instance)}; objects' numbers have 32 bits: number them anew, "
            "np.unique(instance, return_inverse=True)[1]"
        )


def check_metres(known: np.ndarray, what: str) -> None:
    """Raises ValueError, beginning with `what`, for distances of a scale that is not metres; they are finite and beyond
    0, and some."""
    tenth, most = float(np.partition(known, len(known) // 10)[len(known) // 10]), float(known.max())
    if not NEAR_M <= tenth <= FAR_M or most <= UNIT_M:
        raise ValueError(
            f"{what} ({known.dtype}) is {tenth:g} in its nearest tenth, {most:g} at most; it must be in metres: "
            f"{_unit(tenth)}"
        )


def _check_depth(depth_m: np.ndarray, valid: np.ndarray | None, where: str, *, may_be_empty: bool) -> None:
    # A point of depth 0 would lie in the camera's centre.
    below = depth_m < 0 if valid is None else (depth_m <= 0) & valid
    if below.any():
        nothing = "0 or NaN" if valid is None else "False in depth_valid"
        raise ValueError(
            f"{where}: depth_m is {depth_m[below].min():g} at least, {'below 0' if valid is None else '0 or less'} in "
            f"{int(below.sum())} of {below.size} pixels; it must be the distance along the camera's axis in metres: "
            f"turn the sign where the axis points backwards, and give {nothing} where there is nothing"
        )
    *batch, _, _ = depth_m.shape
    for index in np.ndindex(*batch):
        one = depth_m[index]
        seen = None if valid is None else valid[index]
        # A small part first, and all where that part holds nothing.
        known = _known(one[::STRIDE, ::STRIDE], None if seen is None else seen[::STRIDE, ::STRIDE])
        known = known if known.size else _known(one, seen)
        which = f" of view {', '.join(map(str, index))}" if batch else ""
        if not known.size and may_be_empty:
            continue
        if not known.size:
            raise ValueError(
                f"{where}: depth_m{which} is known in no pixel (0, not finite, or not valid in all {one.size}); give "
                "metres where there is something"
            )
        check_metres(known, f"{where}: depth_m{which}")


def _known(depth_m: np.ndarray, valid: np.ndarray | None) -> np.ndarray:
    seen = np.isfinite(depth_m) & (depth_m > 0)
    return depth_m[seen if valid is None else seen & valid]


def _unit(tenth: float) -> str:
    if tenth > FAR_M:
        return "divide millimetres by 1000, centimetres (Virtual KITTI's files) by 100, KITTI's files by 256"
    return "multiply 0..1 by the far plane's distance, kilometres by 1000; take 1 / x of an inverse depth"


_KINDS: dict[str, tuple[str, str]] = {
    "depth_m": ("fiu", "it must be metres in floating point, no picture of the depth"),
    "depth_valid": ("b", "it must be true or false: take .astype(bool)"),
    "semantic": (
        "iu",
        f"it must be Cityscapes ids 0..{CLASSES - 1}, whole numbers: take .astype(np.int32) where it holds these ids",
    ),
    "instance": ("iu", "it must be objects' numbers, whole ones, 0 for none: take .astype(np.int32)"),
}
"""Kinds of NumPy's types that each raster may have, and what is right."""


def _mend_image(shape: tuple[int, ...]) -> str:
    right = "it must be (h, w, 3), red, green, blue"
    if len(shape) >= 3 and shape[-1] == 4:
        return f"{right}: leave the alpha channel out, rgb[..., :3]"
    if len(shape) >= 3 and shape[-3] == 3:
        return f"{right}: put the channels last, np.moveaxis(rgb, -3, -1)"
    return right


def _mend(name: str, shape: tuple[int, ...], size: tuple[int, ...]) -> str:
    right = f"it must be {size}"
    if shape == (*size, 1):
        return f"{right}: squeeze it, {name}[..., 0]"
    if shape[:-1] == size and name == "semantic":
        return f"{right}, a class id a pixel: a picture of the classes must be decoded by its colours"
    if shape[:-1] == size:
        return f"{right}, a number a pixel"
    if len(shape) >= 2 and (*shape[:-2], shape[-1], shape[-2]) == size:
        return f"{right}: turn its axes, np.swapaxes({name}, -1, -2)"
    return f"{right}: render image, depth and labels at one size, or cut all alike"


def _kind(raster: Any) -> np.dtype:
    """Its type, also of JAX's arrays and of lists."""
    return np.dtype(raster.dtype if hasattr(raster, "dtype") else np.asarray(raster).dtype)


def all_within(values: np.ndarray, low: int | float, high: int | float) -> bool:
    """Whether all values are finite and in the interval."""
    finite = values.dtype.kind in "iub" or np.isfinite(values).all()
    # Numbers of Python: not every type of the raster can be compared with every end.
    return not values.size or bool(finite and values.min().item() >= low and values.max().item() <= high)


def span_in_words(values: np.ndarray) -> str:
    """Says from what to what values go, and how many are not finite."""
    known = values[np.isfinite(values)]
    extent = f"{known.min():g}..{known.max():g}" if known.size else "nothing"
    return (
        extent
        if known.size == values.size
        else f"{extent}, {values.size - known.size} of {values.size} NaN or infinite"
    )


def nearest_known(known: Bool[np.ndarray, "h w"]) -> tuple[Float[np.ndarray, "h w"], Int[np.ndarray, "h w"]]:
    """How many pixels each lies from the nearest known one, and that one's place in the raveled raster; 0 where none
    is."""
    away_px, label = cv2.distanceTransformWithLabels(
        (~known).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )
    # Every known pixel has a label of its own, which the pixels nearest to it share.
    label = np.asarray(label, np.int64)
    place = np.zeros(int(label.max()) + 1, np.int64)
    place[label[known]] = np.flatnonzero(known)
    return np.asarray(away_px), place[label]


def close_gaps(raster: Float[np.ndarray, "h w"], valid: Bool[np.ndarray, "h w"]) -> Float[np.ndarray, "h w"]:
    """The raster (float32) whose cells that are not valid have the value of the nearest valid one; 0 where none is."""
    raster = raster.astype(np.float32)
    if valid.all():
        return raster
    if not valid.any():
        return np.zeros_like(raster)
    return raster.ravel()[nearest_known(valid)[1]]
