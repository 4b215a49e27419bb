"""Two folders that show different streets: the rays of each, with the covariates that a range image alone gives.

Letters: n rays (of both sides, thinned), s scenes, f frames. Measured ranges are noisy and simulated ones are not;
angles and heights are taken from both range images after the simulated one was given the noise of the measured one, or
the noise itself would look like an effect of the angle.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float, Int

from jaxsim.data.polar_frames import PolarFrames, open_polar_frames, scene_of
from jaxsim.discover.model.noise_levels import FINEST, lattice_step
from jaxsim.discover.read import thin_frames
from jaxsim.discover.read.checks import (
    all_or_none,
    check_all_differ,
    check_no_copies,
    check_one_grid,
    check_sides,
    constant_intensity,
    levels_of,
    plausible,
    readings_of,
)
from jaxsim.discover.read.notes import sceneless, seconds_apart
from jaxsim.discover.rules import RULES
from jaxsim.discover.scenes import MEDIAN_TO_SD
from jaxsim.effects.places import rays_at
from jaxsim.effects.rays import FLOOR, Rays, Scan
from jaxsim.effects.scan import scan_of
from jaxsim.frame import PolarGrid, PolarImage
from jaxsim.geometry.normals import normals
from jaxsim.geometry.polar import directions

PER_SCENE = 4000
"""Rays of a scene that are looked at."""


@dataclass(frozen=True)
class SideFrames:
    """The frames of one side."""

    names: tuple[str, ...]
    scenes: tuple[str, ...]
    """`simulated/NAME` or `measured/NAME` of each frame."""
    images: tuple[PolarImage, ...]
    semantic: Int[np.ndarray, "f r c"] | None
    """Cityscapes ids."""
    rasters: frozenset[str]
    """Names of what the frames tell besides range and intensity."""
    notes: tuple[str, ...]

    @property
    def digests(self) -> dict[str, bytes]:
        """`readings_of` the images, by their frames' names."""
        return {name: readings_of(image) for name, image in zip(self.names, self.images, strict=True)}

    def readings(self, field: str) -> np.ndarray:
        """A field of the images, of all rays that returned."""
        return np.concatenate([np.asarray(getattr(image, field))[image.valid] for image in self.images])

    @property
    def roughness_m(self) -> float:
        """Standard deviation of the range noise on planes, m."""
        ranges = np.stack([image.range_m for image in self.images])
        return roughness_m(ranges, np.stack([image.valid for image in self.images]))


@dataclass(frozen=True)
class UnpairedComparison:
    """Two folders that show different streets, simulated frames first: their rays that lie on smooth surfaces, thinned,
    with the covariates that a range image gives; and of all rays which were lost."""

    grid: PolarGrid
    scan: Scan
    """The scan of all frames, as if each range image were ideal geometry; intensities as read."""
    rays: Rays
    """The n rays, on the host."""
    log_intensity: Float[np.ndarray, " n"]
    height_m: Float[np.ndarray, " n"]
    """Above the ground."""
    rise: Float[np.ndarray, " n"]
    """Vertical part of the surface normal: 1 flat ground, 0 walls."""
    bend: Float[np.ndarray, " n"]
    """Measure of how much the surface is not flat, share of the range."""
    semantic: Int[np.ndarray, " n"] | None
    """Classes, where both folders give them; else of simulated rays alone."""
    shared_classes: bool
    scene: Int[np.ndarray, " n"]
    """Index into `scenes`."""
    scenes: tuple[str, ...]
    """`simulated/NAME` and `measured/NAME`."""
    measured: Bool[np.ndarray, " s"]
    """Whether a scene was measured."""
    lost: Bool[np.ndarray, "f r c"]
    frame_scene: Int[np.ndarray, " f"]
    frames: tuple[int, int]
    """Simulated and measured."""
    steps: dict[str, float]
    """Steps of the lattices on which measured readings lie and simulated ones do not, by the effect that makes them."""
    noise_m: float
    """Standard deviation of the noise that was given to the simulated ranges."""
    notes: tuple[str, ...] = ()

    @property
    def covariates(self) -> dict[str, Float[np.ndarray, " n"]]:
        """Every ray's covariates that both sides have, as verdicts compare them: range as its ln."""
        return {
            "range": np.log(self.rays.range_m).astype(float),
            "incidence": np.asarray(self.rays.incidence_rad, float),
            "azimuth": np.asarray(self.rays.azimuth_rad, float),
            "row": np.asarray(self.rays.row, float),
        }

    @property
    def rows(self) -> int:
        """Beams of the grid."""
        return len(np.asarray(self.grid.elevation_rad))


def read_folder(frames: PolarFrames, word: str) -> SideFrames:
    """One side's frames, as many as a fit can use; `word` (simulated, measured) is for its scenes and errors. Raises
    ValueError as `read_comparison` does, and for frames of one drive that name no scene."""
    about = [frames.about.get(name, {}) for name in frames.names]
    notes = [f"{word} side: {note}" for note in sceneless(frames.names, about)]
    if seconds_apart(about) < RULES.consecutive_s:
        raise ValueError(
            f"discover: {word} frames have no scene in grid.json, and their times are {seconds_apart(about):g} s "
            f"apart: frames of one drive, it seems, which count as one, and {RULES.unpaired_fewest_scenes} are needed; "
            "give each frame its scene, and more drives"
        )
    names = thin_frames(frames.names, [scene_of(name, frames) for name in frames.names], grid=frames.grid)
    if len(names) < len(frames.names):
        notes.append(f"{len(names)} of {len(frames.names)} {word} frames were read, spread evenly over the scenes")
    images, labels = [], []
    given: set[str] = set()
    for name in names:
        image, rasters = frames.read(name)
        plausible(name, image, word)
        images.append(image)
        given |= {*rasters}
        labels.append({key: value for key, value in rasters.items() if key == "semantic"})
    all_or_none(frames.folder, names, labels)
    known = bool(labels) and all(labels)
    semantic = np.stack([rasters["semantic"] for rasters in labels]).astype(np.int32) if known else None
    scenes = tuple(f"{word}/{scene_of(name, frames)}" for name in names)
    side = SideFrames(tuple(names), scenes, tuple(images), semantic, frozenset(given), tuple(notes))
    # A frame that is there twice is two scenes that agree.
    check_all_differ(frames.folder, side.digests)
    return side


def _noisy(image: PolarImage, noise_m: float, rng: np.random.Generator) -> Float[np.ndarray, "r c"]:
    range_m, valid = np.asarray(image.range_m), np.asarray(image.valid)
    noisy = np.maximum(range_m + rng.normal(0, noise_m, range_m.shape), 0.01)
    return np.where(valid, noisy if noise_m else range_m, 0).astype(np.float32)


def _bent_by_rounding(theirs: SideFrames, steps: dict[str, float]) -> float:
    """The intensity up to which a lattice that measured readings alone lie on bends their law, as weak beams and far
    surfaces show; a quarter of them are as bright or brighter, and stay."""
    step = steps.get("intensity_quantization", 0.0)
    if not step:
        return 0.0
    intensity = theirs.readings("intensity")
    # Between two of the lattice's values: many readings may be the very quantile.
    below_bright = float(np.quantile(intensity[intensity > 0], RULES.unpaired_bright_quantile)) - step / 2
    return min(RULES.unpaired_bent_steps * step, below_bright)


def _rounded(image: PolarImage, steps: dict[str, float]) -> PolarImage:
    """Simulated intensities on the lattice of measured ones, so that both sides leave out the same dark ones."""
    step = steps.get("intensity_quantization", 0.0)
    return replace(image, intensity=step * np.round(np.asarray(image.intensity) / step)) if step else image


def read_unpaired(simulated: Path, measured: Path, *, per_scene: int = PER_SCENE) -> UnpairedComparison:
    """Two folders of polar frames that need share no street and no names; `per_scene` rays of each scene are kept.

    Raises ValueError where grids differ, values have wrong units, frames are empty, or both folders hold a frame of
    the same readings.
    """
    predicted = open_polar_frames(simulated)
    recorded = open_polar_frames(measured)
    check_one_grid(predicted, recorded)
    grid = predicted.grid
    ours = read_folder(predicted, "simulated")
    theirs = read_folder(recorded, "measured")
    check_no_copies(predicted, recorded, sides=(ours.digests, theirs.digests))
    check_sides(predicted.folder, recorded.folder, rasters=(ours.rasters, theirs.rasters))
    flat = constant_intensity(*([levels_of(image) for image in side.images] for side in (ours, theirs)))
    # What the simulated ranges lack of the measured ones' noise.
    noise_m = float(np.sqrt(max(theirs.roughness_m**2 - ours.roughness_m**2, 0.0)))
    steps = _steps(ours, theirs)
    rng = np.random.default_rng(0)
    images = [
        *(replace(_rounded(image, steps), range_m=_noisy(image, noise_m, rng)) for image in ours.images),
        *(replace(image, range_m=_noisy(image, 0.0, rng)) for image in theirs.images),
    ]
    shape = images[0].valid.shape
    labels = [
        np.zeros((len(side.names), *shape), np.int32) if side.semantic is None else side.semantic
        for side in (ours, theirs)
    ]
    semantic = np.concatenate(labels)
    both = ours.semantic is not None and theirs.semantic is not None
    # Effects of classes act where both sides know them.
    scan = scan_of(grid, images, [{"semantic": frame if both else np.zeros_like(frame)} for frame in semantic])
    scenes = tuple(dict.fromkeys((*ours.scenes, *theirs.scenes)))
    frame_scene = np.array([scenes.index(name) for name in (*ours.scenes, *theirs.scenes)])
    surfaces = _surfaces(scan, len(ours.names))
    # A reading of 0 has no logarithm, and says only that it was too weak.
    dark = _bent_by_rounding(theirs, steps)
    lit = np.stack([np.asarray(image.intensity) > dark for image in images])
    good = surfaces.smooth & lit & (scan.incidence_rad < RULES.compared_below_rad)
    at = _thinned(good, frame_scene, rng, most=per_scene)
    rays = jax.tree.map(np.asarray, rays_at(scan, tuple(part.astype(np.int32) for part in at)))
    return UnpairedComparison(
        grid=grid,
        scan=scan,
        rays=rays,
        log_intensity=np.log(np.maximum(scan.intensity[at], FLOOR)).astype(np.float64),
        height_m=surfaces.height_m[at],
        rise=surfaces.rise[at],
        bend=surfaces.bend[at],
        semantic=None if ours.semantic is None else semantic[at],
        shared_classes=both,
        scene=frame_scene[at[0]],
        scenes=scenes,
        measured=np.array([name.startswith("measured/") for name in scenes]),
        lost=~np.stack([np.asarray(image.valid) for image in images]),
        frame_scene=frame_scene,
        frames=(len(ours.names), len(theirs.names)),
        steps=steps,
        noise_m=noise_m,
        notes=(*ours.notes, *theirs.notes, *flat, *_other_heights(surfaces), *_same_streets(ours, theirs)),
    )


def _other_heights(surfaces: _Surfaces) -> tuple[str, ...]:
    ours_m, theirs_m = surfaces.below_m
    if not max(ours_m / theirs_m, theirs_m / ours_m) > RULES.unpaired_height_factor:
        return ()
    return (
        f"the ground lies {ours_m:.2g} m below the simulated sensor and {theirs_m:.2g} m below the measured one: "
        "ranges in another unit than metres on one side (feet), or another car?",
    )


def _same_streets(ours: SideFrames, theirs: SideFrames) -> tuple[str, ...]:
    common = [name for name in ours.names if name in theirs.names]
    agree = []
    for name in common[:8]:
        a = ours.images[ours.names.index(name)]
        b = theirs.images[theirs.names.index(name)]
        both = a.valid & b.valid
        agree.append(np.mean(np.abs(a.range_m - b.range_m)[both] < RULES.unpaired_same_m) if both.any() else 0.0)
    # Names alone prove nothing: two recordings often number their frames alike.
    if agree and np.mean(agree) > RULES.unpaired_same_share:
        return (
            f"{len(common)} frames of the same name show the same street on both sides: without --unpaired they are "
            "compared ray by ray, which tells many more effects apart",
        )
    return ()


def roughness_m(range_m: np.ndarray, valid: np.ndarray) -> float:
    """Standard deviation of the range noise that the steps between neighbours on planes show, m.

    On a plane 1 / range is straight along a row; what is left of it has 1.5 times the variance of one reading.
    """
    r = np.where(valid, range_m, np.nan).astype(np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        # The middle ray against the line through its neighbours, in 1 / range and then back in metres.
        off = ((1 / r[..., :-2] + 1 / r[..., 2:]) / 2 * r[..., 1:-1] - 1) * r[..., 1:-1]
    near = np.abs(off) < RULES.edge_bend * r[..., 1:-1]
    return float(MEDIAN_TO_SD * np.median(np.abs(off[near])) / np.sqrt(1.5)) if near.any() else 0.0


def _steps(ours: SideFrames, theirs: SideFrames) -> dict[str, float]:
    """Steps of the measured readings' lattices that are clearly coarser than the simulated ones'."""
    steps = {}
    for name, field in (("intensity_quantization", "intensity"), ("range_quantization", "range_m")):
        step = lattice_step(theirs.readings(field), finest=FINEST[name])
        if step > RULES.coarser_step * lattice_step(ours.readings(field), finest=FINEST[name]):
            steps[name] = step
    return steps


class _Surfaces(NamedTuple):
    """What rays meet."""

    height_m: Float[np.ndarray, "f r c"]
    """Above the ground."""
    rise: Float[np.ndarray, "f r c"]
    """Vertical part of the normal."""
    bend: Float[np.ndarray, "f r c"]
    smooth: Bool[np.ndarray, "f r c"]
    below_m: tuple[float, float]
    """How far the ground lies below the simulated and the measured sensor; NaN where none is seen."""


def _surfaces(scan: Scan, simulated: int) -> _Surfaces:
    """What the rays of simulated frames, which come first, and of measured ones meet."""
    grid = scan.grid
    # Every beam from its own origin: those of a turning head stand centimetres apart.
    height = scan.range_m * np.asarray(directions(grid))[..., 2] + np.asarray(grid.origin_m)[:, None]
    rise = np.zeros_like(height)
    has_normal = np.zeros(height.shape, bool)
    for k in range(len(height)):
        normal, sure = normals(scan.range_m[k], scan.hit[k], grid)
        rise[k] = np.abs(np.asarray(normal)[..., 2])
        has_normal[k] = np.asarray(sure)
    below_m: list[float] = []
    for side in (slice(None, simulated), slice(simulated, None)):
        # Roofs of cars and bridges are level too, but not below the sensor.
        level = has_normal[side] & (rise[side] > RULES.unpaired_level_rise) & (height[side] < -RULES.unpaired_below_m)
        # Zero is the ground under each side's own sensor, whatever height its grid claims.
        below_m.append(float(-np.median(height[side][level])) if level.any() else np.nan)
        height[side] += np.nan_to_num(below_m[-1])
    # On a plane 1 / range is straight along rows and columns.
    r = np.where(scan.hit, scan.range_m, np.nan).astype(np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        along_row = np.abs((1 / np.roll(r, 1, 2) + 1 / np.roll(r, -1, 2)) / 2 * r - 1)
        along_column = np.abs((1 / np.roll(r, 1, 1) + 1 / np.roll(r, -1, 1)) / 2 * r - 1)
    # np.roll carries the other end's rays to the borders. A border row bends as its neighbour does.
    along_row[..., [0, -1]] = np.nan
    along_column[:, [0, -1]] = along_column[:, [1, -2]]
    smooth = has_normal & scan.hit & (along_row < RULES.edge_bend)
    bend = np.nan_to_num(np.minimum(along_column, 1.0), nan=1.0)
    return _Surfaces(height, rise, bend, smooth, (below_m[0], below_m[1]))


def _thinned(
    good: np.ndarray, frame_scene: np.ndarray, rng: np.random.Generator, *, most: int
) -> tuple[np.ndarray, ...]:
    """Frame, row and column of at most so many rays of each scene."""
    frame, row, column = np.nonzero(good)
    scene = frame_scene[frame]
    samples: list[np.ndarray] = []
    for s in np.unique(scene):
        rays = np.flatnonzero(scene == s)
        samples.append(rays if len(rays) <= most else np.sort(rng.choice(rays, most, replace=False)))
    chosen = np.concatenate(samples)
    return frame[chosen], row[chosen], column[chosen]
