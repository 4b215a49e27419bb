"""Labelled range images of the embedded world, with classes that shape does not tell from what they lie on.

A road's markings and its wet patches are as flat as the road, a number plate is as upright as the car, a sign's sheet
as the board: intensity tells them apart. The form is that of `jaxsim.data.range_images`.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from jaxsim.data.cityscapes import IDS
from jaxsim.data.synthetic.render import IdealScan
from jaxsim.data.synthetic.world import SyntheticWorld
from jaxsim.files import write_arrays
from jaxsim.geometry import polar_to_points

_OF_SHAPE = {
    "road": ("road",),
    "pavement": ("sidewalk", "ground", "parking"),
    "terrain": ("terrain",),
    "building": ("building", "wall", "fence"),
    "vegetation": ("vegetation",),
    "pole": ("pole", "static"),
    "sign": ("traffic sign",),
    "vehicle": ("car", "truck", "bus"),
    "person": ("person", "rider", "bicycle"),
}
"""Cityscapes' classes that are one here."""
OF_MATERIAL = ("marking", "wet road", "number plate", "sign's sheet")
"""Classes that lie in the plane of another."""
LABEL_CLASSES = ("unlabelled", *_OF_SHAPE, *OF_MATERIAL)
"""By number, as the files hold them."""


def classes_of(scan: IdealScan) -> Int[np.ndarray, "rows columns"]:
    """The class of what each ray meets; 0 in the sky."""
    by_id = np.zeros(max(IDS.values()) + 1, np.int32)
    for number, names in enumerate(_OF_SHAPE.values(), start=1):
        by_id[[IDS[name] for name in names]] = number
    label = by_id[np.asarray(scan.semantic)]
    is_sign = label == LABEL_CLASSES.index("sign")
    for name, where in (
        ("wet road", np.asarray(scan.wet)),
        # Paint under water is seen as paint.
        ("marking", np.asarray(scan.marking)),
        ("number plate", np.asarray(scan.retro) & ~is_sign),
        ("sign's sheet", np.asarray(scan.retro) & is_sign),
    ):
        label[where] = LABEL_CLASSES.index(name)
    return np.where(np.asarray(scan.valid), label, 0)


def labelled_image(world: SyntheticWorld, index: int) -> Float[np.ndarray, "rows columns 6"]:
    """A frame's x, y, z, intensity, range and class of each cell; 0 where nothing came back."""
    truth = world.truth(index)
    image = world.measure(index, truth)
    xyz = np.asarray(polar_to_points(image, world.grid).xyz_m).reshape(*image.range_m.shape, 3)
    rasters = [xyz, image.intensity[..., None], image.range_m[..., None], classes_of(truth.scan)[..., None]]
    return np.where(image.valid[..., None], np.concatenate(rasters, axis=-1), 0).astype(np.float32)


def write_labelled(folder: Path, world: SyntheticWorld, indices: Iterable[int]) -> None:
    """Writes frames as NAME.npz; those that are there are not rendered again."""
    for index in indices:
        path = folder / f"{world.name_of(index)}.npz"
        if not path.is_file():
            write_arrays(path, {"scan": labelled_image(world, index)})
