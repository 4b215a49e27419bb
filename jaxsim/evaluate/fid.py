"""Fréchet distance of a run: its intensity images against the measured ones, as the paper's framework takes them.

Both at the network's size, grey repeated three times, in [-1, 1]: the generator's image as it comes out, before it
is rounded to the sensor's steps, and the target as training shows it (denoised where the run denoises; 0 where
nothing came back). Every judged frame counts once.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jaxsim.config import PrepareConfig
from jaxsim.frame import Array, Pair
from jaxsim.geometry import resample
from jaxsim.metrics.frechet import FrechetScore, frechet_score, halves, load_halves, save_halves, statistics_file
from jaxsim.metrics.inception import Extractor
from jaxsim.pairs.prepared import PreparedPairs
from jaxsim.prepare import network_inputs
from jaxsim.simulate.predict import Generate

BATCH = 8


def make_images(generate: Generate, prepare: PrepareConfig) -> tuple[Callable[..., Array], Callable[[Pair], Array]]:
    """Jitted: (parameters, pairs) -> the generator's images; pairs -> the measured ones. Both (b, h, w, 1)."""

    @jax.jit
    def predicted(params: Any, pair: Pair) -> Array:
        return generate(params, network_inputs(pair.painted, pair.incidence_rad, pair.row, prepare=prepare))[..., :1]

    @jax.jit
    def measured(pair: Pair) -> Array:
        return 2 * resample(pair.target, prepare.network_size, batch_dims=1)[..., None] - 1

    return predicted, measured


def _in_batches(pairs: Iterable[Pair], image: Callable[[Pair], Array]) -> Iterator[Float[np.ndarray, "h w 1"]]:
    """Images one by one, made from runs of pairs that share a window (drives of one calibration do).

    Short runs are filled up, so that one compiled program serves all of a window.
    """

    def runs() -> Iterator[list[Pair]]:
        waiting: list[Pair] = []
        for pair in pairs:
            if waiting and (len(waiting) == BATCH or pair.target.shape != waiting[0].target.shape):
                yield waiting
                waiting = []
            waiting.append(pair)
        yield waiting

    for chosen in runs():
        filled = chosen + [chosen[-1]] * (BATCH - len(chosen))
        images = np.asarray(image(jax.tree.map(lambda *leaves: jnp.stack(leaves), *filled)))
        yield from images[: len(chosen)]


def data_name(pairs: PreparedPairs, prepare: PrepareConfig) -> str:
    """A name for the measured images of these pairs: it changes with the frames, their preparation and the size."""
    keys = "\n".join(pairs.keys)
    digest = hashlib.sha256(f"{prepare.network_size}\n{keys}".encode()).hexdigest()
    return f"{pairs.keys[0].split('-')[0]}-{len(pairs)}-{digest[:16]}"


def frechet_of_run(
    generate: Generate,
    params: Any,
    judged: PreparedPairs,
    *,
    extractor: Extractor,
    prepare: PrepareConfig,
    cache: Path,
) -> FrechetScore:
    """Distance between predicted and measured images of these frames; the measured statistics are kept in `cache`.

    Raises ValueError, before any image is looked at, where there are too few frames.
    """
    require_images(len(judged), extractor)
    predicted, measured = make_images(generate, prepare)
    data = data_name(judged, prepare)
    about = {"extractor": extractor.name, "data": data}
    path = statistics_file(cache, **about)
    real = load_halves(path, **about)
    if real is None:
        real = halves(extractor.batches(_in_batches(judged, measured), BATCH))
        save_halves(path, real, **about)
    fake = halves(extractor.batches(_in_batches(judged, lambda pair: predicted(params, pair)), BATCH))
    return frechet_score(fake, real, name=extractor.score)


def require_images(count: int, extractor: Extractor) -> None:
    """Raises ValueError where a distance over that many images would be all bias."""
    if count <= extractor.width:
        raise ValueError(
            f"{extractor.score}: {count} frames to judge, {extractor.width} features; a covariance needs more images "
            f"than features. Judge {extractor.width + 1} frames or more (--frames), or take fewer features "
            "(--fid-features 64: another score, under another name)"
        )


def frechet_line(score: FrechetScore) -> str:
    """What the score is, what it rests on and how far the size of the sets moves it."""
    counts = f"{score.counts[0]} predicted and {score.counts[1]} measured images, {score.features} features"
    bias = (
        ""
        if score.half is None
        else (f"; from half the images {score.half:.2f}: small sets raise the score: compare it at this number alone")
    )
    return f"{score.name} {score.value:.2f} ({counts}{bias})"
