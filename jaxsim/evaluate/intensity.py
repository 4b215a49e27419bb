"""Scores of a trained generator: cell by cell with baselines beside it, and the Fréchet distance of its images.

A cell counts where the camera saw it: there, and only there, the network can know anything.

Images are compared as the paper's framework takes them, at the network's size, grey repeated three times, in [-1, 1]:
the generator's image as it comes out, before it is rounded to the sensor's steps, and the target as training shows it
(denoised where the run denoises; 0 where nothing came back). Every judged frame counts once.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jaxsim.config import PrepareConfig
from jaxsim.frame import Array, Pair
from jaxsim.geometry import resample
from jaxsim.metrics import GroupMeans, Score, group_means, paired_scores, paired_sums
from jaxsim.metrics.frechet import FrechetScore, frechet_score, halves, load_halves, save_halves, statistics_file
from jaxsim.metrics.inception import Extractor
from jaxsim.metrics.paired import DROP_BELOW
from jaxsim.pairs.prepared import PreparedPairs
from jaxsim.prepare import network_inputs
from jaxsim.simulate.predict import Generate

Predict = Callable[[Any, Pair], Array]
CLASSES = 34


def _total(sums: Iterable[dict[str, Array]]) -> dict[str, Score]:
    frames = list(sums)
    return paired_scores({key: sum(float(frame[key]) for frame in frames) for key in frames[0]})


def _sums(intensity: Array, drops: Array, pair: Pair) -> dict[str, Array]:
    measured = pair.measured
    return paired_sums(intensity, drops, measured.intensity, returned=measured.valid, m=pair.painted.valid)


def score_pairs(predict: Predict, params: Any, pairs: Sequence[Pair]) -> dict[str, Score]:
    """Paired scores of a generator (`mae`, `rmse`, `psnr`, `ssim`, `drop_iou`, `drop_f1`)."""
    predictions = ((predict(params, pair), pair) for pair in pairs)
    return _total(_sums(x, x < DROP_BELOW, pair) for x, pair in predictions)


GROUPS: dict[str, Callable[[Pair], np.ndarray]] = {
    "global mean": lambda pair: np.zeros(pair.target.shape, int),
    "per-class mean": lambda pair: np.clip(pair.painted.semantic, 0, CLASSES - 1),
    "per-row mean": lambda pair: np.broadcast_to(np.arange(len(pair.target))[:, None], pair.target.shape),
}
"""The baselines that average training cells: name -> group of each cell."""


def baseline_scores(
    train: Sequence[Pair], judged: Sequence[Pair], previous: Sequence[Pair | None]
) -> dict[str, dict[str, Score]]:
    """Scores of each baseline on `judged`; `previous` holds the frame before each, None where there is none.

    The previous frame's intensity is copied cell by cell; where it has none, the global mean stands in.
    """
    found: dict[str, dict[str, Score]] = {}
    means: dict[str, GroupMeans] = {}
    for name, group in GROUPS.items():
        if name == "per-class mean" and not any((pair.painted.semantic > 0).any() for pair in train):
            continue
        rows = max(len(pair.target) for pair in [*train, *judged])
        measured = ((pair.measured.intensity, pair.measured.valid, pair.painted.valid, group(pair)) for pair in train)
        means[name] = group_means(measured, max(rows, CLASSES))
        mean = means[name]
        found[name] = _total(
            _sums(mean.intensity.astype(np.float32)[group(pair)], mean.drops[group(pair)], pair) for pair in judged
        )
    copied = [(pair, before.measured) for pair, before in zip(judged, previous, strict=True) if before]
    if copied:
        filling = np.float32(means["global mean"].intensity[0])
        found["previous frame"] = _total(
            _sums(
                np.where(before.valid, before.intensity, filling),
                ~before.valid | (before.intensity < DROP_BELOW),
                pair,
            )
            for pair, before in copied
        )
    return found


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
    if score.half is not None:
        counts += (
            f"; from half the images {score.half:.2f}: small sets raise the score: compare it at this number alone"
        )
    return f"{score.name} {score.value:.2f} ({counts})"
