"""Scores of a trained generator: cell by cell with baselines beside it, and the Fréchet distance of its images.

A cell counts where the camera saw it: there, and only there, the network can know anything.

Images are compared as the paper's framework takes them, at the network's size, grey repeated three times, in [-1, 1]:
the generator's image as it comes out, before it is rounded to the sensor's steps, and the target as training shows it
(denoised where the run denoises; 0 where nothing came back). Every judged frame counts once.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jaxtyping import Float

from jaxsim.config import QUANTILES, PrepareConfig
from jaxsim.evaluate.baselines import Baseline, fit_baselines, fit_trees, previous_frame
from jaxsim.frame import INTENSITY_STEP, LOST_BELOW, Array, Pair
from jaxsim.geometry import resample
from jaxsim.metrics import Score
from jaxsim.metrics.frechet import (
    FrechetScore,
    frechet_score,
    halves,
    load_halves,
    require_images,
    save_halves,
    statistics_file,
)
from jaxsim.metrics.inception import Extractor
from jaxsim.metrics.paired import frame_sums, total_scores
from jaxsim.pairs.prepared import PreparedPairs
from jaxsim.prepare import network_inputs
from jaxsim.progress import Progress
from jaxsim.simulate.predict import Generate, Prediction

Predict = Callable[[Any, Pair], Prediction]


PairedSums = list[dict[str, float]]
"""Paired sums of each judged frame."""


def _sums(intensity: Array, drops: Array, pair: Pair) -> dict[str, float]:
    measured = pair.measured
    return frame_sums(intensity, drops, y=measured.intensity, returned=measured.valid, m=pair.painted.valid)


def network_sums(predict: Predict, params: Any, pairs: Sequence[Pair]) -> PairedSums:
    """What a generator makes of each pair."""
    shown = {"desc": "scoring", "unit": "frame", "leave": False}
    predictions = ((predict(params, pair), pair) for pair in Progress(pairs, **shown))
    return [_sums(x.intensity, x.drops, pair) for x, pair in predictions]


def score_pairs(predict: Predict, params: Any, pairs: Sequence[Pair]) -> dict[str, Score]:
    """Paired scores of a generator (`mae`, `rmse`, `psnr`, `ssim`, `drop_iou`, `drop_f1`)."""
    return total_scores(network_sums(predict, params, pairs))


def coverage(predict: Predict, params: Any, pairs: Sequence[Pair]) -> dict[str, Score]:
    """Share of returned cells whose measured intensity lies between the outer QUANTILES, and between the inner ones;
    and the Brier score of the drop's probability. Nothing for a network that gives no distribution, and where no cell
    counts.

    A cell counts where the camera saw it and its beam came back. One that reports 0 counts in both: the quantiles and
    the drop's probability are learned from it alike.
    """
    inside = np.zeros(2)
    cells = 0
    square = 0.0
    seen = 0
    for pair in pairs:
        says = predict(params, pair)
        if says.quantiles is None or says.drop_share is None:
            return {}
        quantiles, share = np.asarray(says.quantiles), np.asarray(says.drop_share)
        value, back = np.asarray(pair.measured.intensity), np.asarray(pair.measured.valid)
        looked = np.asarray(pair.painted.valid)
        counts = looked & back
        half = INTENSITY_STEP / 2  # the sensor rounds: a quantile within it of what is reported covers that
        for k in range(2):
            # Pairs from outside in: the k-th and the k-th from the end.
            low, high = quantiles[..., k] - half, quantiles[..., -1 - k] + half
            inside[k] += ((value >= low) & (value <= high))[counts].sum()
        cells += int(counts.sum())
        drops = ~back | (value < LOST_BELOW)
        square += float(((share - drops)[looked] ** 2).sum())
        seen += int(looked.sum())
    if not cells:
        return {}
    percent = [round(100 * (QUANTILES[-1 - k] - QUANTILES[k])) for k in range(2)]
    covered = {f"coverage_{percent[k]}": Score(inside[k] / cells, "1", cells) for k in range(2)}
    return covered | {"drop_brier": Score(square / seen, "1", seen)}


def baseline_frames(baselines: Mapping[str, Baseline], pairs: Iterable[Pair]) -> dict[str, PairedSums]:
    """What each fitted baseline makes of each pair, which is read once."""
    sums: dict[str, PairedSums] = {name: [] for name in baselines}
    for pair in pairs:
        for name, guess in baselines.items():
            sums[name].append(_sums(*guess(pair), pair))
    return sums


def baseline_sums(
    train: Sequence[Pair], judged: Sequence[Pair], previous: Sequence[Pair | None], *, trees: bool = False
) -> dict[str, PairedSums]:
    """What each baseline makes of each judged pair; with `trees` also boosted trees (`baselines`), each of which reads
    the training pairs anew, one at a time.

    `previous` holds the frame before each, None where there is none: the previous frame's are of those that have one.
    """
    baselines = fit_baselines(train)
    if trees:
        baselines |= {name: fit_trees(train, context=context) for name, context in TREES.items()}
    sums = baseline_frames(baselines, judged)
    copied = [(pair, before) for pair, before in zip(judged, previous, strict=True) if before]
    if copied:
        # The one number of the global mean, wherever it is read.
        filling = float(baselines["global mean"](copied[0][0]).intensity[0, 0])
        sums["previous frame"] = [_sums(*previous_frame(before, filling), pair) for pair, before in copied]
    return sums


TREES = {"trees, a cell": False, "trees, context": True}
"""Baselines of boosted trees: name -> whether they see the cell's surroundings."""


BATCH = 8


def make_images(generate: Generate, prepare: PrepareConfig) -> tuple[Callable[..., Array], Callable[[Pair], Array]]:
    """Jitted: (parameters, pairs) -> the generator's images; pairs -> the measured ones. Both (b, h, w, 1)."""

    @jax.jit
    def predicted(params: Any, pair: Pair) -> Array:
        inputs = network_inputs(pair.painted, pair.incidence_rad, pair.row_share, prepare=prepare)
        images = generate(params, inputs)
        # Of a distribution the median, which is what is scored cell by cell, too.
        channel = QUANTILES.index(0.5) if images.shape[-1] > len(QUANTILES) else 0
        return images[..., channel : channel + 1]

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
        images = np.asarray(image(jax.tree.map(lambda *leaves: np.stack(leaves), *filled)))
        yield from images[: len(chosen)]


def data_name(pairs: PreparedPairs, prepare: PrepareConfig) -> str:
    """A name for the measured images of these pairs: it changes with the frames, their preparation and the size."""
    keys = "\n".join(pairs.keys)
    digest = hashlib.sha256(f"{prepare.network_size}\n{keys}".encode()).hexdigest()
    return f"{pairs.keys[0].split('-')[0]}-{len(pairs)}-{digest[:16]}"


def frechet_of_run(
    generate: Generate, params: Any, judged: PreparedPairs, *, extractor: Extractor, prepare: PrepareConfig, cache: Path
) -> FrechetScore:
    """Distance between predicted and measured images of these frames; the measured statistics are kept in `cache`.

    Raises ValueError, before any image is looked at, where there are too few frames.
    """
    require_images(len(judged), extractor.width, name=extractor.score)
    predicted, measured = make_images(generate, prepare)
    data = data_name(judged, prepare)
    about = {"extractor": extractor.name, "data": data}
    path = statistics_file(cache, **about)
    real = load_halves(path, **about)
    if real is None:
        real = halves(extractor.batches(_in_batches(judged, measured), BATCH))
        save_halves(path, real, **about)
    # Never kept: each checkpoint predicts other images.
    fake = halves(extractor.batches(_in_batches(judged, lambda pair: predicted(params, pair)), BATCH))
    return frechet_score(fake, real, name=extractor.score)


def frechet_line(score: FrechetScore) -> str:
    """What the score is, what it rests on and how far the size of the sets moves it."""
    counts = f"{score.counts[0]} predicted and {score.counts[1]} measured images, {score.features} features"
    if score.half is not None:
        counts += (
            f"; from half the images {score.half:.2f}: small sets raise the score: compare it at this number alone"
        )
    return f"{score.name} {score.value:.2f} ({counts})"
