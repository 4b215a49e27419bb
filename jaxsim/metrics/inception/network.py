"""Inception v3 (Szegedy et al. 2016), up to its pooled 2048 features, in two published forms.

torchvision's, and pytorch-fid's port of the 2015 TensorFlow graph, which differs in the pooling branches: averages
leave the border's padding out, and the last block takes a maximum. Modules are named as the published state dicts
name them; batch norm is folded into the convolutions.
"""

from __future__ import annotations

from functools import partial
from typing import Literal

import jax
import jax.numpy as jnp
from flax import nnx
from jax import Array
from jaxtyping import Float

from jaxsim.products import PRECISION

InceptionForm = Literal["torchvision", "pytorch_fid"]
Features = Float[Array, "b _h _w _c"]

max_pool = partial(nnx.max_pool, window_shape=(3, 3))
WIDTHS = (64, 192, 768, 2048)
"""Channels at the places where features are taken: after both stem poolings, before the last reduction, at the end."""


class Conv(nnx.Conv):
    """Convolution with folded batch norm, then ReLU. `same` pads by half the kernel on every side."""

    def __init__(
        self,
        channels: int,
        width: int,
        size: int | tuple[int, int] = 1,
        *,
        stride: int = 1,
        same: bool = True,
        rngs: nnx.Rngs,
    ):
        kernel = (size, size) if isinstance(size, int) else size
        padding = [(k // 2, k // 2) if same else (0, 0) for k in kernel]
        # Not the accelerator's default: half-precision products would change the distance.
        super().__init__(channels, width, kernel, (stride, stride), padding=padding, precision=PRECISION, rngs=rngs)

    def __call__(self, x: Features) -> Features:  # type: ignore[override]
        return jax.nn.relu(super().__call__(x))


def _pool(x: Features, form: InceptionForm, *, last: bool = False) -> Features:
    """The pooling branch: 3 x 3 at every cell."""
    around = ((1, 1), (1, 1))
    # The graph of 2015 takes a maximum in its last block alone; the published weights were trained so.
    if last and form == "pytorch_fid":
        return nnx.pool(x, -jnp.inf, jax.lax.max, (3, 3), (1, 1), around)
    # torchvision's mean counts the padding, always nine cells; the other counts the cells that are there.
    cells = jnp.full((1, *x.shape[1:3], 1), 9, x.dtype)
    if form == "pytorch_fid":
        cells = nnx.pool(jnp.ones_like(cells), 0.0, jax.lax.add, (3, 3), (1, 1), around)
    return nnx.pool(x, 0.0, jax.lax.add, (3, 3), (1, 1), around) / cells


def _joined(*branches: Features) -> Features:
    return jnp.concatenate(branches, axis=-1)


class BlockA(nnx.Module):
    """35 x 35 cells: 1 x 1, 5 x 5, two 3 x 3, pooling."""

    def __init__(self, channels: int, pool: int, form: InceptionForm, *, rngs: nnx.Rngs) -> None:
        conv = partial(Conv, rngs=rngs)
        self.form: InceptionForm = form
        self.branch1x1 = conv(channels, 64)
        self.branch5x5_1, self.branch5x5_2 = conv(channels, 48), conv(48, 64, 5)
        self.branch3x3dbl_1, self.branch3x3dbl_2 = conv(channels, 64), conv(64, 96, 3)
        self.branch3x3dbl_3 = conv(96, 96, 3)
        self.branch_pool = conv(channels, pool)

    def __call__(self, x: Features) -> Features:
        return _joined(
            self.branch1x1(x),
            self.branch5x5_2(self.branch5x5_1(x)),
            self.branch3x3dbl_3(self.branch3x3dbl_2(self.branch3x3dbl_1(x))),
            self.branch_pool(_pool(x, self.form)),
        )


class BlockB(nnx.Module):
    """35 x 35 to 17 x 17 cells."""

    def __init__(self, channels: int, *, rngs: nnx.Rngs) -> None:
        conv = partial(Conv, rngs=rngs)
        self.branch3x3 = conv(channels, 384, 3, stride=2, same=False)
        self.branch3x3dbl_1, self.branch3x3dbl_2 = conv(channels, 64), conv(64, 96, 3)
        self.branch3x3dbl_3 = conv(96, 96, 3, stride=2, same=False)

    def __call__(self, x: Features) -> Features:
        return _joined(
            self.branch3x3(x),
            self.branch3x3dbl_3(self.branch3x3dbl_2(self.branch3x3dbl_1(x))),
            max_pool(x, strides=(2, 2)),
        )


class BlockC(nnx.Module):
    """17 x 17 cells: 7 x 7 taken apart into rows and columns, `n` channels wide inside."""

    def __init__(self, channels: int, n: int, form: InceptionForm, *, rngs: nnx.Rngs) -> None:
        conv = partial(Conv, rngs=rngs)
        self.form: InceptionForm = form
        self.branch1x1 = conv(channels, 192)
        self.branch7x7_1, self.branch7x7_2 = conv(channels, n), conv(n, n, (1, 7))
        self.branch7x7_3 = conv(n, 192, (7, 1))
        self.branch7x7dbl_1, self.branch7x7dbl_2 = conv(channels, n), conv(n, n, (7, 1))
        self.branch7x7dbl_3, self.branch7x7dbl_4 = conv(n, n, (1, 7)), conv(n, n, (7, 1))
        self.branch7x7dbl_5 = conv(n, 192, (1, 7))
        self.branch_pool = conv(channels, 192)

    def __call__(self, x: Features) -> Features:
        twice = self.branch7x7dbl_3(self.branch7x7dbl_2(self.branch7x7dbl_1(x)))
        return _joined(
            self.branch1x1(x),
            self.branch7x7_3(self.branch7x7_2(self.branch7x7_1(x))),
            self.branch7x7dbl_5(self.branch7x7dbl_4(twice)),
            self.branch_pool(_pool(x, self.form)),
        )


class BlockD(nnx.Module):
    """17 x 17 to 8 x 8 cells."""

    def __init__(self, channels: int, *, rngs: nnx.Rngs) -> None:
        conv = partial(Conv, rngs=rngs)
        self.branch3x3_1, self.branch3x3_2 = conv(channels, 192), conv(192, 320, 3, stride=2, same=False)
        self.branch7x7x3_1, self.branch7x7x3_2 = conv(channels, 192), conv(192, 192, (1, 7))
        self.branch7x7x3_3, self.branch7x7x3_4 = conv(192, 192, (7, 1)), conv(192, 192, 3, stride=2, same=False)

    def __call__(self, x: Features) -> Features:
        wide = self.branch7x7x3_3(self.branch7x7x3_2(self.branch7x7x3_1(x)))
        return _joined(self.branch3x3_2(self.branch3x3_1(x)), self.branch7x7x3_4(wide), max_pool(x, strides=(2, 2)))


class BlockE(nnx.Module):
    """8 x 8 cells: 3 x 3 taken apart into a row and a column beside each other."""

    def __init__(self, channels: int, form: InceptionForm, *, rngs: nnx.Rngs, last: bool = False) -> None:
        conv = partial(Conv, rngs=rngs)
        self.form: InceptionForm = form
        self.last = last
        self.branch1x1, self.branch3x3_1 = conv(channels, 320), conv(channels, 384)
        self.branch3x3_2a, self.branch3x3_2b = conv(384, 384, (1, 3)), conv(384, 384, (3, 1))
        self.branch3x3dbl_1, self.branch3x3dbl_2 = conv(channels, 448), conv(448, 384, 3)
        self.branch3x3dbl_3a, self.branch3x3dbl_3b = conv(384, 384, (1, 3)), conv(384, 384, (3, 1))
        self.branch_pool = conv(channels, 192)

    def __call__(self, x: Features) -> Features:
        once, twice = self.branch3x3_1(x), self.branch3x3dbl_2(self.branch3x3dbl_1(x))
        return _joined(
            self.branch1x1(x),
            *(self.branch3x3_2a(once), self.branch3x3_2b(once)),
            *(self.branch3x3dbl_3a(twice), self.branch3x3dbl_3b(twice)),
            self.branch_pool(_pool(x, self.form, last=self.last)),
        )


class Inception(nnx.Module):
    """Feature maps of images of 299 x 299 cells in [-1, 1]."""

    def __init__(self, form: InceptionForm, rngs: nnx.Rngs) -> None:
        conv = partial(Conv, rngs=rngs)
        # Attributes bear the published names, by which weights are read.
        self.Conv2d_1a_3x3 = conv(3, 32, 3, stride=2, same=False)
        self.Conv2d_2a_3x3, self.Conv2d_2b_3x3 = conv(32, 32, 3, same=False), conv(32, 64, 3)
        self.Conv2d_3b_1x1, self.Conv2d_4a_3x3 = conv(64, 80), conv(80, 192, 3, same=False)
        self.Mixed_5b = BlockA(192, 32, form, rngs=rngs)
        self.Mixed_5c = BlockA(256, 64, form, rngs=rngs)
        self.Mixed_5d = BlockA(288, 64, form, rngs=rngs)
        self.Mixed_6a = BlockB(288, rngs=rngs)
        self.Mixed_6b = BlockC(768, 128, form, rngs=rngs)
        self.Mixed_6c = BlockC(768, 160, form, rngs=rngs)
        self.Mixed_6d = BlockC(768, 160, form, rngs=rngs)
        self.Mixed_6e = BlockC(768, 192, form, rngs=rngs)
        self.Mixed_7a = BlockD(768, rngs=rngs)
        self.Mixed_7b, self.Mixed_7c = BlockE(1280, form, rngs=rngs), BlockE(2048, form, rngs=rngs, last=True)

    def __call__(self, x: Float[Array, "b h w 3"]) -> dict[int, Features]:
        """Feature maps by their channels (`WIDTHS`)."""
        x = self.Conv2d_2b_3x3(self.Conv2d_2a_3x3(self.Conv2d_1a_3x3(x)))
        maps = {64: max_pool(x, strides=(2, 2))}
        x = self.Conv2d_4a_3x3(self.Conv2d_3b_1x1(maps[64]))
        maps[192] = x = max_pool(x, strides=(2, 2))
        for block in (self.Mixed_5b, self.Mixed_5c, self.Mixed_5d, self.Mixed_6a):
            x = block(x)
        for block in (self.Mixed_6b, self.Mixed_6c, self.Mixed_6d, self.Mixed_6e):
            x = block(x)
        maps[768] = x
        for block in (self.Mixed_7a, self.Mixed_7b, self.Mixed_7c):
            x = block(x)
        return maps | {2048: x}
