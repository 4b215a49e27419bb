"""LIDIA's network: from a patch, its neighbours at two scales and their distances to the patch without noise.

Vaksman, Elad, Milanfar: LIDIA, Lightweight Learned Image Denoising with Instance Adaptation, CVPR Workshops 2020;
layer plan of grishavak/LIDIA-denoiser `code/modules.py`, whose names the modules bear.

Features are (neighbour, patch, cell), so that linear maps along a patch's cells and along its neighbours are one matrix
product each and nothing is transposed. Names and layouts of parameters are those of the published state dicts: weights
are (out, in).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from flax import nnx, struct
from jax import Array
from jaxtyping import Float, Int

from jaxsim.prepare.denoise.lidia.patches import NEIGHBOURS, blur, fold, pad, patch_counts, unfold
from jaxsim.prepare.denoise.lidia.stages import BatchNorm, Stage, Statistics, through
from jaxsim.products import einsum, tensordot


class Linear(nnx.Module):
    """y = W x along the first axis (`along_first`) or the last one."""

    def __init__(self, inputs: int, outputs: int, *, bias: bool = False, rngs: nnx.Rngs):
        bound = inputs**-0.5
        draw = lambda shape: jax.random.uniform(rngs.params(), shape, jnp.float32, -bound, bound)  # noqa: E731
        self.weight = nnx.Param(draw((outputs, inputs)))
        if bias:
            self.bias = nnx.Param(draw((outputs,)))

    def along_first(self, x: Float[Array, "i *n"]) -> Float[Array, "o *n"]:
        """The layer on the first axis."""
        return tensordot(self.weight[...], x, 1)

    def along_last(self, x: Float[Array, "*n i"]) -> Float[Array, "*n o"]:
        """The layer on the last axis."""
        return einsum("...i,oi->...o", x, self.weight[...])


class VerHor(nnx.Module):
    """The separable layer: a map along cells (`ver`), one along neighbours (`hor`), and a bias for each of both."""

    def __init__(self, ver: tuple[int, int], hor: tuple[int, int], *, rngs: nnx.Rngs):
        self.ver, self.hor = Linear(*ver, rngs=rngs), Linear(*hor, rngs=rngs)
        spread = 2.0 / (ver[1] + hor[1]) ** 0.5  # Xavier, with the gain of a ReLU
        self.b = nnx.Param(spread * jax.random.normal(rngs.params(), (hor[1], ver[1]), jnp.float32))

    def __call__(self, x: Float[Array, "i n u"]) -> Float[Array, "o n v"]:
        outputs, inputs = self.hor.weight.shape
        # The two commute: the one that makes less of it goes first.
        if outputs < inputs:
            x = self.ver.along_last(self.hor.along_first(x))
        else:
            x = self.hor.along_first(self.ver.along_last(x))
        return x + self.b[...][:, None, :]


class VerHorBnRe(nnx.Module):
    """Separable layer, batch norm if `norm`, ReLU."""

    def __init__(self, ver: tuple[int, int], hor: tuple[int, int], *, norm: bool, rngs: nnx.Rngs):
        self.ver_hor = VerHor(ver, hor, rngs=rngs)
        self.bn = BatchNorm(hor[1]) if norm else None

    def __call__(self, x: Float[Array, "i n u"]) -> Float[Array, "o n v"]:
        """The layer without batch norm, which is the following stage's."""
        x = self.ver_hor(x)
        return jax.nn.relu(x) if self.bn is None else x


class WeightsNet(nnx.Module):
    """From the distances of a patch's neighbours to the factor that each neighbour gets."""

    LAYERS = 6

    def __init__(self, neighbours: int, *, rngs: nnx.Rngs):
        for k in range(self.LAYERS):
            setattr(self, f"fc{k}", Linear(neighbours, neighbours, rngs=rngs))
            setattr(self, f"bn{k}", BatchNorm(neighbours))
        self.fc_out = Linear(neighbours, neighbours, bias=True, rngs=rngs)

    def __call__(
        self, x: Float[Array, "k n"], counted: Float[Array, " n"], statistics: Statistics
    ) -> Float[Array, "k n"]:
        for k in range(self.LAYERS):
            x = getattr(self, f"fc{k}").along_first(x)
            x = jax.nn.relu(getattr(self, f"bn{k}")(x[..., None], counted, statistics)[..., 0])
        return self.fc_out.along_first(x) + self.fc_out.bias[...][:, None]


class Variant(NamedTuple):
    """Which of the published networks."""

    colour: bool = False
    """Images of three channels. The published small network is for grey ones alone."""
    small: bool = False
    """Without the two blended layers: two thirds of the parameters."""

    @property
    def p(self) -> int:
        """Patch width."""
        return 5 if self.colour else 7

    @property
    def channels(self) -> int:
        """Channels of an image: 3 of a colour image, 1 of intensity."""
        return 3 if self.colour else 1

    @property
    def numel(self) -> int:
        """Values of a patch."""
        return self.p**2 * self.channels

    @property
    def width(self) -> int:
        """Features that take the place of a patch's values."""
        return 80 if self.colour else 64


@struct.dataclass
class Scale:
    """What the network sees of all n patches at one scale."""

    table: Float[Array, "m numel"]
    """Patches to choose neighbours from."""
    index: Int[Array, "14 n"]
    """Each patch's neighbours in the table, itself first."""
    distance: Float[Array, "14 n"]
    """Of the 13 others, ascending; last the patch's own variance times its values."""


class Part1(nnx.Module):
    """One scale alone."""

    def __init__(self, variant: Variant, rngs: nnx.Rngs):
        k, wide = NEIGHBOURS, variant.width
        self.ver_hor_bn_re0 = VerHorBnRe((variant.numel, wide), (k, k), norm=False, rngs=rngs)
        self.ver_hor_bn_re1 = None if variant.small else VerHorBnRe((wide, wide), (k, k), norm=True, rngs=rngs)
        self.a = None if variant.small else nnx.Param(jnp.zeros(1))

    def stages(self, begin: Callable[..., Array]) -> list[Stage]:
        """From what `begin` makes of the arrays to the features."""
        first = Stage(lambda *arrays: self.ver_hor_bn_re0(begin(*arrays)))
        return _blended(self.a, [first], self.ver_hor_bn_re1, end=lambda x: x)


class Part2(nnx.Module):
    """Both scales and both aggregations together: a patch's noise."""

    def __init__(self, variant: Variant, rngs: nnx.Rngs):
        k, wide = 4 * NEIGHBOURS, variant.width
        self.ver_hor_bn_re2 = VerHorBnRe((wide, wide), (k, k), norm=True, rngs=rngs)
        self.ver_hor_bn_re3 = None if variant.small else VerHorBnRe((wide, wide), (k, k), norm=True, rngs=rngs)
        self.a = None if variant.small else nnx.Param(jnp.zeros(1))
        self.ver_hor_out = VerHor((wide, variant.numel), (k, 1), rngs=rngs)

    def stages(self, begin: Callable[..., Array]) -> list[Stage]:
        """From what `begin` makes of the arrays to the noise."""
        first = Stage(lambda *arrays: self.ver_hor_bn_re2(begin(*arrays)), self.ver_hor_bn_re2.bn)
        return _blended(self.a, [first], self.ver_hor_bn_re3, end=self.ver_hor_out)


def _blended(a: Any, stages: list[Stage], layer: VerHorBnRe | None, *, end: Callable[[Array], Array]) -> list[Stage]:
    """These stages, the blend of their result with a second layer's by the learned share `a`, and `end`."""
    if layer is None:
        return [*stages, Stage(end)]
    return [*stages, Stage(layer, layer.bn), Stage(lambda x, more: end(a[0] * x + (1 - a[0]) * more))]


class SeparableNet(nnx.Module):
    """From both scales' weighted neighbours to the noise of every patch."""

    def __init__(self, variant: Variant, rngs: nnx.Rngs):
        k = NEIGHBOURS
        wide = variant.width
        numel = variant.numel
        self.sep_part1_s0, self.sep_part1_s1 = Part1(variant, rngs), Part1(variant, rngs)
        self.ver_hor_agg0_pre = VerHor((wide, numel), (k, 1), rngs=rngs)
        self.ver_hor_bn_re_agg0_post = VerHorBnRe((numel, wide), (1, k), norm=False, rngs=rngs)
        self.ver_hor_agg1_pre = VerHor((wide, numel), (k, 1), rngs=rngs)
        self.ver_hor_bn_re_agg1_post = VerHorBnRe((numel, wide), (1, k), norm=False, rngs=rngs)
        self.sep_part2 = Part2(variant, rngs)


class PatchDenoiser(nnx.Module):
    """The whole network on patches."""

    def __init__(self, variant: Variant, rngs: nnx.Rngs):
        if variant.colour and variant.small:
            raise ValueError("lidia: there is no small network for colour images; take the full one")
        self.variant = variant
        self.separable_fc_net = SeparableNet(variant, rngs)
        self.weights_net0 = WeightsNet(NEIGHBOURS, rngs=rngs)
        self.weights_net1 = WeightsNet(NEIGHBOURS, rngs=rngs)
        self.alpha0 = nnx.Param(jnp.full(1, 0.5))
        self.alpha1 = nnx.Param(jnp.full(1, 0.5))
        self.beta = nnx.Param(jnp.full(1, 0.5))

    def __call__(
        self,
        fine: Scale,
        coarse: Scale,
        counted: Float[Array, " n"],
        *,
        shape: tuple[int, int, int],
        statistics: Statistics,
        chunk: int,
    ) -> tuple[Float[Array, "n numel"], Float[Array, " n"]]:
        """Patches without noise, and the weight of each where they overlap.

        shape: images, rows and columns of patches (their product is n). `chunk` patches at a time go through the
        layers; with statistics of the image, of each chunk's patches, as in the published program.
        """
        net, p = self.separable_fc_net, self.variant.p
        # A neighbour counts by exp(-|alpha| distance), alpha learned; 0 is the image's scale, 1 that of its blurred
        # copy.
        weight0 = self.weights_net0(jnp.exp(-jnp.abs(self.alpha0[0]) * fine.distance), counted, statistics)
        weight1 = self.weights_net1(jnp.exp(-jnp.abs(self.alpha1[0]) * coarse.distance), counted, statistics)

        steps = {"counted": counted, "statistics": statistics, "chunk": chunk}

        def part1(part: Part1, scale: Scale, weight: Array, *, pre: VerHor) -> tuple[Array, ...]:
            # (14 neighbours, patches, values): the layers mix neighbours and values in turn, each axis by itself.
            begin = lambda index, weight: scale.table[index] * weight[..., None]  # noqa: E731
            stages = [*part.stages(begin), Stage(lambda *results: pre(results[-1]))]
            return through(stages, (scale.index, weight), keep=2, **steps)

        x0, pre0 = part1(net.sep_part1_s0, fine, weight0, pre=net.ver_hor_agg0_pre)
        x1, pre1 = part1(net.sep_part1_s1, coarse, weight1, pre=net.ver_hor_agg1_pre)

        def aggregate(x: Array, d: int) -> Array:
            """Patches that overlap agree on their mean."""
            image = fold(x.reshape(*shape, -1), p, d) / patch_counts(*shape[1:], p, d=d)
            return unfold(image if d == 1 else blur(pad(image, 1, "reflect")), p, d).reshape(1, -1, x.shape[-1])

        # Patches of the coarse scale have cells two apart (d = 2).
        agreed0 = aggregate(pre0, 1)
        # At the coarse scale the patch's own factor is taken out before patches meet, and put back after.
        agreed1 = weight1[:1, :, None] * aggregate(pre1 / weight1[:1, :, None], 2)

        def begin(*arrays: Array) -> Array:
            *features, agreed0, agreed1 = arrays
            more = net.ver_hor_bn_re_agg0_post(agreed0), net.ver_hor_bn_re_agg1_post(agreed1)
            return jnp.concatenate([*features, *more])

        (noise,) = through(net.sep_part2.stages(begin), (x0, x1, agreed0, agreed1), **steps)
        # The network gives the noise; the first neighbour is the patch itself.
        clean = fine.table[fine.index[0]] - noise[0]
        # Flat patches count most where patches overlap: the weight falls with the cleaned patch's variance.
        spread = jnp.mean((clean - clean.mean(-1, keepdims=True)) ** 2, -1)
        return clean, jnp.exp(-jnp.abs(self.beta[0]) * spread)
