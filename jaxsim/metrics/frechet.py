"""Fréchet distance between two sets of features, each taken as a Gaussian (Heusel et al. 2017).

d = |m1 - m2|^2 + tr(C1 + C2 - 2 (C1 C2)^(1/2)), with mean m and covariance C (divided by n - 1), in float64 on the
host. The trace of the root is the sum of singular values of A1' A2 where C = A A': no root of a product is taken,
so that singular covariances cost no accuracy.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import scipy.linalg
from jaxtyping import Float

from jaxsim.files import placed, read_arrays, write_arrays

FEWEST_FEATURES = 64
"""That the published network gives: those of its first block."""


@dataclass(frozen=True)
class Moments:
    """Count, mean and scatter (sum of outer products of what differs from the mean) of features."""

    count: int
    mean: Float[np.ndarray, " d"]
    scatter: Float[np.ndarray, "d d"]

    @staticmethod
    def of(features: Float[np.ndarray, "n d"]) -> Moments:
        """The moments of one batch."""
        x = np.asarray(features, np.float64)
        if not np.isfinite(x).all():
            raise ValueError("frechet: features are not finite; look at the images that they were taken from")
        mean = x.mean(0)
        return Moments(len(x), mean, (x - mean).T @ (x - mean))

    def merge(self, other: Moments) -> Moments:
        """The moments of both sets together (Chan et al. 1983)."""
        if self.mean.shape != other.mean.shape:
            raise ValueError(f"frechet: sets have {self.mean.size} and {other.mean.size} features; they must agree")
        count = self.count + other.count
        step = other.mean - self.mean
        share = other.count / count
        # Beside the two scatters that of the two means: n1 n2 / (n1 + n2) times their difference squared.
        scatter = self.scatter + other.scatter + np.outer(step, step) * (self.count * share)
        return Moments(count, self.mean + step * share, scatter)

    @property
    def covariance(self) -> Float[np.ndarray, "d d"]:
        """Divided by n - 1. Raises ValueError for fewer than two samples."""
        if self.count < 2:
            raise ValueError(f"frechet: {self.count} sample has no covariance; give two or more")
        return self.scatter / (self.count - 1)


def _factor(covariance: Float[np.ndarray, "d d"]) -> Float[np.ndarray, "d rank"]:
    """A with A A' = C, without the directions in which C is nothing but rounding."""
    values, vectors = scipy.linalg.eigh(covariance)
    # The usual bound of a numerical rank: the largest eigenvalue times d eps.
    positive = values > values[-1] * len(values) * np.finfo(np.float64).eps
    return vectors[:, positive] * np.sqrt(values[positive])


def _nuclear(matrix: Float[np.ndarray, "n m"]) -> float:
    """Sum of the singular values."""
    return float(np.linalg.svd(matrix, compute_uv=False).sum())


def frechet_distance(a: Moments, b: Moments) -> float:
    """Squared Fréchet distance between the Gaussians of two sets, in units of the features squared."""
    if a.mean.shape != b.mean.shape:
        raise ValueError(f"frechet: sets have {a.mean.size} and {b.mean.size} features; they must agree")
    first, second = a.covariance, b.covariance
    # A set without spread has no factor; its root is 0.
    root = _nuclear(_factor(first).T @ _factor(second)) if first.any() and second.any() else 0.0
    step = a.mean - b.mean
    return float(step @ step + np.trace(first) + np.trace(second) - 2 * root)


def frechet_distance_of(x: Float[np.ndarray, "n d"], y: Float[np.ndarray, "m d"]) -> float:
    """The same distance straight from features, where samples are fewer than features: no d x d matrix is made.

    Raises ValueError where a set has fewer than two samples.
    """
    if min(len(x), len(y)) < 2:
        raise ValueError(f"frechet: {len(x)} and {len(y)} samples; one has no covariance: give two or more of each")
    a = np.asarray(x, np.float64)
    b = np.asarray(y, np.float64)
    step = a.mean(0) - b.mean(0)
    # Divided so, the rows are a factor A' of the covariance already: C = A A'.
    a = (a - a.mean(0)) / np.sqrt(len(a) - 1)
    b = (b - b.mean(0)) / np.sqrt(len(b) - 1)
    return float(step @ step + (a * a).sum() + (b * b).sum() - 2 * _nuclear(a @ b.T))


class Halves(NamedTuple):
    """A set's moments, of its even and of its odd images: together the whole, apart a measure of the bias."""

    even: Moments
    odd: Moments

    @property
    def whole(self) -> Moments:
        """The moments of all images."""
        return self.even.merge(self.odd)


def halves(batches: Iterable[Float[np.ndarray, "_n d"]]) -> Halves:
    """Moments of features that arrive batch by batch. Raises ValueError for fewer than two images."""
    parts: list[Moments | None] = [None, None]
    seen = 0
    for batch in batches:
        for half in range(2):
            # Even and odd by the place in the whole set, wherever a batch begins.
            chosen = batch[(half + seen) % 2 :: 2]
            if len(chosen):
                added, before = Moments.of(chosen), parts[half]
                parts[half] = added if before is None else before.merge(added)
        seen += len(batch)
    even, odd = parts
    if even is None or odd is None:
        raise ValueError(f"frechet: {seen} images; give two or more")
    return Halves(even, odd)


@dataclass(frozen=True)
class FrechetScore:
    """A distance and what it rests on."""

    name: str
    """`fid` over the published Inception's 2048 features alone."""
    value: float
    half: float | None
    """The same score from half the images, mean of both halves: it exceeds `value` by about as much as `value`
    exceeds the score of endless sets. None where a half has too few images."""
    counts: tuple[int, int]
    features: int


def require_images(count: int, features: int, *, name: str) -> None:
    """Raises ValueError where a distance over so many images would be all bias: it needs more than features."""
    if count <= features:
        fewer = ", or take fewer features (--fid-features 64: another score, under another name)"
        raise ValueError(
            f"{name}: {count} frames to judge, {features} features; a covariance needs more images than features: "
            f"judge at least {features + 1} frames (--frames){fewer if features > FEWEST_FEATURES else ''}"
        )


def frechet_score(a: Halves, b: Halves, *, name: str) -> FrechetScore:
    """Distance between two sets of images.

    Raises ValueError where a set has no more images than features: its covariance is singular, and the bias of the
    small sample outweighs what is to be seen.
    """
    first, second = a.whole, b.whole
    features = first.mean.size
    require_images(min(first.count, second.count), features, name=name)
    half = None
    # The bias falls as 1 / n, so halves have about twice that of the whole.
    if min(part.count for part in (*a, *b)) > 1:
        half = float(np.mean([frechet_distance(x, y) for x, y in zip(a, b, strict=True)]))
    return FrechetScore(name, frechet_distance(first, second), half, (first.count, second.count), features)


def statistics_file(folder: Path, *, extractor: str, data: str) -> Path:
    """Where the moments of a data set are kept: the name says the network, its weights and the images."""
    return folder / f"frechet-{extractor}-{data}.npz"


def save_halves(path: Path, statistics: Halves, *, extractor: str, data: str) -> None:
    """Writes the moments and what they are of."""
    arrays: dict[str, Any] = {"extractor": np.array(extractor), "data": np.array(data)}
    for name, part in zip(Halves._fields, statistics, strict=True):
        arrays |= {f"{name}.count": np.array(part.count), f"{name}.mean": part.mean, f"{name}.scatter": part.scatter}
    write_arrays(path, arrays)


def load_halves(path: Path, *, extractor: str, data: str) -> Halves | None:
    """Kept moments; None where there are none. Raises ValueError where the file holds others, or is damaged."""
    if not path.is_file():
        return None
    arrays = read_arrays(path, by="frechet", again="delete it", summed=True)
    with placed(f"frechet: {path} is no readable file of statistics", KeyError, TypeError, then="delete it"):
        made_by = tuple(str(arrays[name]) for name in ("extractor", "data"))
        parts = (
            Moments(int(arrays[f"{name}.count"]), arrays[f"{name}.mean"], arrays[f"{name}.scatter"])
            for name in Halves._fields
        )
        statistics = Halves(*parts)
    if made_by != (extractor, data):
        raise ValueError(f"frechet: {path} holds statistics of {made_by}, not of {(extractor, data)}; delete it")
    return statistics
