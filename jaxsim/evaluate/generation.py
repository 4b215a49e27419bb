"""LiDAR generation metrics between two folders: polar frames, or clouds (.bin as KITTI has them, .npz as ours).

One pass a folder keeps histograms and images, no cloud; frames of the same name are then compared as pairs.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jaxsim.cloud import points_of
from jaxsim.data.clouds import SUFFIXES, cloud_files, read_cloud
from jaxsim.data.polar_frames import PolarFrames, open_polar_frames
from jaxsim.files import files_in
from jaxsim.frame import PolarGrid, PolarImage
from jaxsim.geometry import incidence, pad_points, polar_to_points, room_for, same_grid
from jaxsim.metrics import Score
from jaxsim.metrics.bev import COUNTS, jensen_shannon, lidm_occupancy, mmd
from jaxsim.metrics.chamfer import chamfer
from jaxsim.metrics.conditional import conditional_intensity, intensity_table
from jaxsim.metrics.frechet import frechet_distance_of
from jaxsim.metrics.rangenet import Values, range_features
from jaxsim.metrics.sliced_wasserstein import sliced_wasserstein

BATCH, POINTS = 8, 2**14
"""Clouds of a batch, and the multiple that they are padded to."""


@dataclass(frozen=True)
class Folder:
    """Frames of one folder, read when asked for."""

    path: Path
    names: tuple[str, ...]
    frames: PolarFrames | None
    """None: a folder of clouds."""

    @property
    def grid(self) -> PolarGrid | None:
        """The grid of polar frames; None in a folder of clouds."""
        return self.frames and self.frames.grid

    def image(self, name: str) -> tuple[PolarImage, dict[str, np.ndarray]]:
        """A polar frame and its further rasters. Raises ValueError where its raster is not the grid's."""
        assert self.frames is not None
        return self.frames.read(name)

    def points(self, name: str) -> Float[np.ndarray, "n 4"]:
        """Rows x, y, z (m), intensity (0..1; 0 where a cloud has none)."""
        if self.frames is not None:
            return points_of(polar_to_points(self.image(name)[0], self.frames.grid))
        path = self.path / f"{name}.bin"
        points = read_cloud(path if path.is_file() else path.with_suffix(".npz"))
        return points if points.shape[1] == 4 else np.pad(points, ((0, 0), (0, 1)))


def open_folder(path: Path) -> Folder:
    """A folder of polar frames (with grid.json) or of clouds. Raises ValueError where it is neither."""
    polar = (path / "grid.json").is_file()
    names = [file.stem for file in (files_in(path, *SUFFIXES) if polar else cloud_files(path))]
    if not names:
        raise ValueError(
            f"generation: {path} holds no frames; give a folder of polar frames (grid.json, NAME.npz; `jaxsim "
            "discover --help` tells the format) or of clouds (.bin with x, y, z, intensity float32, or .npz with xyz)"
        )
    if polar:
        frames = open_polar_frames(path)
        return Folder(path, frames.names, frames)
    return Folder(path, tuple(names), None)


def _batches(folder: Folder) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """(b, n, 4) points and (b, n) which of them are real."""
    for first in range(0, len(folder.names), BATCH):
        clouds = [folder.points(name) for name in folder.names[first : first + BATCH]]
        room = room_for(max(map(len, clouds)), POINTS)
        padded = [pad_points(cloud, room) for cloud in clouds]
        yield np.stack([points for points, _ in padded]), np.stack([real for _, real in padded])


def _histograms(folder: Folder) -> dict[str, np.ndarray]:
    """BEV histograms of every frame (n, 100, 100) by definition, and `lidm`: the occupancy of all."""
    histograms: dict[str, list[np.ndarray]] = {name: [] for name in COUNTS}
    occupancy = np.zeros((1, 1), np.float32)
    for points, valid in _batches(folder):
        for name, count in COUNTS.items():
            histograms[name].append(np.asarray(count(points[..., :3], valid)))
        occupancy = occupancy + lidm_occupancy(cloud[kept, :3] for cloud, kept in zip(points, valid, strict=True))
    return {name: np.concatenate(parts) for name, parts in histograms.items()} | {"lidm": occupancy}


def _bev(a: Folder, b: Folder) -> dict[str, Score]:
    first, second = _histograms(a), _histograms(b)
    count = min(len(a.names), len(b.names))
    scores = {}
    for name in COUNTS:
        scores[f"{name}_jsd"] = Score(jensen_shannon(first[name].sum(0), second[name].sum(0)), "1", count)
        scores[f"{name}_mmd"] = Score(mmd(first[name], second[name], definition=name), "1", count)
    return scores | {"lidm_jsd": Score(jensen_shannon(first["lidm"], second["lidm"]), "1", count)}


def _pictures(folder: Folder, names: Sequence[str]) -> np.ndarray:
    """Range (logarithmic, 0..1 at 63 m; 0 where nothing returned) and intensity of every frame."""
    pictures = []
    for name in names:
        image, _ = folder.image(name)
        # log2(63 + 1) = 6: the scale ends at 63 m, and near ranges take most of it.
        log = np.clip(np.log2(image.range_m + 1) / 6, 0, 1)
        pictures.append(np.where(image.valid[..., None], np.stack([log, image.intensity], -1), 0))
    return np.stack(pictures).astype(np.float32)


def _tables(a: Folder, b: Folder) -> tuple[np.ndarray, np.ndarray, bool]:
    """Tables of intensity of both folders, and whether they have classes.

    Angles come from each side's own range image. A frame without classes takes those of its namesake.
    """
    shared = {*a.names} & {*b.names} if a.grid and b.grid and same_grid(a.grid, b.grid) else set()
    tables, classes = [], True
    for folder, other in ((a, b), (b, a)):
        assert folder.grid is not None
        table = jnp.zeros((), jnp.int32)
        for name in folder.names:
            image, more = folder.image(name)
            semantic = more.get("semantic")
            if semantic is None and name in shared:
                semantic = other.image(name)[1].get("semantic")
            classes = classes and semantic is not None
            label = np.zeros(image.valid.shape, np.int32) if semantic is None else np.asarray(semantic, np.int32)
            angle, known = incidence(image.range_m, image.valid, folder.grid)
            table = table + intensity_table(
                image.intensity, image.range_m, angle, incidence_known=known, semantic=label, valid=image.valid
            )
        tables.append(np.asarray(table))
    return tables[0], tables[1], classes


def generation_scores(a: Folder, b: Folder, *, rangenet: Values | None = None) -> dict[str, Score]:
    """Every metric that these folders allow (`a` simulated, `b` measured): name -> value, unit, frames or rays.

    Polar frames on one grid have all; clouds have the bird's-eye-view and Chamfer distances. Chamfer distances are
    of frames of the same name. With RangeNet's values also the Fréchet distance over range images.
    """
    scores = _bev(a, b)
    shared = sorted({*a.names} & {*b.names})
    if shared:
        pairs = [chamfer(a.points(name)[:, :3], b.points(name)[:, :3]) for name in shared]
        for name, unit in (("distance_m", "m"), ("square_m2", "m2"), ("density_aware", "1")):
            value = float(np.mean([getattr(pair, name) for pair in pairs]))
            scores[f"chamfer_{name}"] = Score(value, unit, len(pairs))
    if rangenet is not None:
        clouds = [((points[..., :3], points[..., 3], valid) for points, valid in _batches(f)) for f in (a, b)]
        value = frechet_distance_of(*(range_features(rangenet, of) for of in clouds))
        scores["frechet_rangenet53"] = Score(value, "1", min(len(a.names), len(b.names)))
    if a.grid is None or b.grid is None:
        return scores
    if same_grid(a.grid, b.grid) and min(len(a.grid.elevation_rad), len(a.grid.azimuth_rad)) >= 16:
        count = min(len(a.names), len(b.names))
        names = (shared, shared) if len(shared) == count else (a.names[:count], b.names[:count])
        swd = sliced_wasserstein(*(_pictures(f, n) for f, n in zip((a, b), names, strict=True)))
        scores |= {name: Score(value, "1", count) for name, value in swd.items()}
    first, second, classes = _tables(a, b)
    for name, score in conditional_intensity(first, second, classes=classes).items():
        scores[name] = Score(score.distance, "intensity", score.rays)
        scores[f"{name}_floor"] = Score(score.floor, "intensity", score.rays)
    return scores
