"""How patches go through layers: some at a time, for what one layer makes of all of them fills no cache, and all of
them between two stages where batch norm asks for their statistics.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
from flax import nnx
from jax import Array
from jaxtyping import Float, Shaped

from jaxsim.products import matmul

Statistics = Literal["stored", "image", "training"]
"""What batch norm divides by: the training set's statistics, stored with the weights; those of the patches at hand;
or these, and the stored ones move towards them."""
EPS, MOMENTUM = 1e-5, 0.1
BLOCK = 256
"""Patches at a time: 56 neighbours' 64 features of them take 3.5 MiB, and stay in the last cache."""


class Moments(NamedTuple):
    """Of features of patches that count: how many values, their means, and their squared deviations from these."""

    number: Float[Array, "*blocks"]
    mean: Float[Array, "*blocks c"]
    deviation: Float[Array, "*blocks c"]

    @classmethod
    def of(cls, x: Float[Array, "c n u"], counted: Float[Array, " n"]) -> Moments:
        """The moments over patches and cells."""
        number = counted.sum() * x.shape[-1]
        # A product with the counts: XLA on a CPU sums over two axes number by number.
        weight = jnp.repeat(counted, x.shape[-1])
        flat = x.reshape(x.shape[0], -1)
        mean = matmul(flat, weight) / jnp.maximum(number, 1.0)
        off = flat - mean[:, None]
        return cls(number, mean, matmul(off * off, weight))

    def joined(self) -> Moments:
        """Those of all blocks together (Chan, Golub, LeVeque: Updating Formulae and a Pairwise Algorithm, 1979)."""
        number = self.number.sum()
        mean = (self.number[:, None] * self.mean).sum(0) / jnp.maximum(number, 1.0)
        between = self.number[:, None] * (self.mean - mean[None]) ** 2
        return Moments(number, mean, (self.deviation + between).sum(0))


class BatchNorm(nnx.Module):
    """Each neighbour's features at mean 0 and variance 1 over patches and cells, then scaled and shifted."""

    def __init__(self, channels: int):
        self.weight, self.bias = nnx.Param(jnp.ones(channels)), nnx.Param(jnp.zeros(channels))
        self.running_mean, self.running_var = nnx.BatchStat(jnp.zeros(channels)), nnx.BatchStat(jnp.ones(channels))

    def __call__(self, x: Float[Array, "c n u"], counted: Float[Array, " n"], statistics: Statistics) -> Array:
        """`counted` is 1 for patches that belong to the statistics, 0 for others."""
        if statistics == "stored":
            return self._scaled(x, self.running_mean[...], self.running_var[...])
        moments = Moments.of(x, counted)
        if statistics == "training":
            unbiased = moments.deviation / jnp.maximum(moments.number - 1.0, 1.0)
            for kept, new in ((self.running_mean, moments.mean), (self.running_var, unbiased)):
                kept[...] = (1 - MOMENTUM) * kept[...] + MOMENTUM * jax.lax.stop_gradient(new)
        return self.by(x, moments)

    def by(self, x: Float[Array, "c n u"], moments: Moments) -> Array:
        """The layer with these moments."""
        return self._scaled(x, moments.mean, moments.deviation / jnp.maximum(moments.number, 1.0))

    def _scaled(self, x: Array, mean: Array, variance: Array) -> Array:
        rate = self.weight[...] * jax.lax.rsqrt(variance + EPS)
        return x * rate[:, None, None] + (self.bias[...] - mean * rate)[:, None, None]


class Stage(NamedTuple):
    """What is worked out patch by patch."""

    function: Callable[..., Array]
    """Of the arrays that enter; from the second stage on, of the results of all stages before."""
    norm: BatchNorm | None = None
    """Normalises the result, which is rectified then, for the stages that follow."""


def through(
    stages: Sequence[Stage],
    arrays: tuple[Array, ...],
    *,
    counted: Float[Array, " n"],
    statistics: Statistics,
    chunk: int,
    keep: int = 1,
) -> tuple[Array, ...]:
    """What the last `keep` stages make of arrays whose second axis are patches, of which some count.

    With statistics of the image those of each `chunk` of patches, as in the published program; otherwise a chunk is
    what is worked on at a time.
    """

    def at_once(arrays: tuple[Array, ...], counted: Array) -> tuple[Array, ...]:
        results: list[Array] = []
        for function, norm in stages:
            x = function(*(results or arrays))
            results.append(x if norm is None else jax.nn.relu(norm(x, counted, statistics)))
        return tuple(results[-keep:])

    function = partial(_by_blocks, stages, keep=keep) if statistics == "image" else at_once
    if len(counted) <= chunk:
        return function(arrays, counted)
    parts = tuple(_cut(x, chunk) for x in (*arrays, counted[None]))
    done = jax.lax.map(lambda part: function(part[:-1], part[-1][0]), parts)
    return tuple(_joined(x, len(counted)) for x in done)


def _by_blocks(
    stages: Sequence[Stage], arrays: tuple[Array, ...], counted: Float[Array, " n"], *, keep: int
) -> tuple[Array, ...]:
    """The last stages' results with the statistics of these patches: each stage has seen all blocks before the next."""
    blocks = tuple(_cut(x, BLOCK) for x in arrays)
    counts = _cut(counted[None], BLOCK)
    results: list[Array] = []
    known: list[Callable[[Array], Array]] = []  # what makes a block's result ready for the stages that follow
    for function, norm in stages:
        given, ready = tuple(results) or blocks, known or [_same] * len(blocks)

        def one(block: tuple[tuple[Array, ...], Array]) -> tuple[Array, Moments | None]:
            x = function(*(make(x) for make, x in zip(ready, block[0], strict=True)))  # noqa: B023
            return x, None if norm is None else Moments.of(x, block[1][0])  # noqa: B023

        x, moments = jax.lax.map(one, (given, counts))
        results.append(x)
        known.append(_same if norm is None else partial(_rectified, norm, moments.joined()))
    return tuple(_joined(x, len(counted)) for x in results[-keep:])


def _same(x: Array) -> Array:
    return x


def _rectified(norm: BatchNorm, moments: Moments, x: Array) -> Array:
    return jax.nn.relu(norm.by(x, moments))


def _cut(x: Shaped[Array, "c n *u"], size: int) -> Shaped[Array, "blocks c size *u"]:
    """Blocks of patches, all of one shape, so that one program is compiled; what fills up the last does not count."""
    x = jnp.pad(x, [(0, 0), (0, -x.shape[1] % size), *[(0, 0)] * (x.ndim - 2)])
    return jnp.moveaxis(x.reshape(x.shape[0], -1, size, *x.shape[2:]), 1, 0)


def _joined(x: Float[Array, "blocks c size *u"], n: int) -> Float[Array, "c n *u"]:
    x = jnp.moveaxis(x, 0, 1)
    return x.reshape(x.shape[0], -1, *x.shape[3:])[:, :n]
