"""Clouds as pictures, and as a page that turns them: simulated ones beside what was measured, and those that a detector
has looked at with what it found."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from jaxsim.cloud import points_of
from jaxsim.config import DetectorExperiment
from jaxsim.data import Dataset
from jaxsim.data.polar_frames import open_polar_frames
from jaxsim.evaluate.cloud_folder import CloudFolder, read_points
from jaxsim.frame import Cloud, Painted, PolarImage
from jaxsim.geometry import polar_to_points
from jaxsim.report.boxes import draw_above, draw_on_image
from jaxsim.report.pictures import draw_cloud, save_picture, simulated_picture
from jaxsim.report.scenes import CLOUDS_PAGE, TurnedScene, cloud_with_boxes, compared_clouds, write_clouds
from jaxsim.simulate.folder import pictures_of


def draw_simulated(out: Path, name: str, cloud: Cloud, *, image: PolarImage, painted: Painted) -> None:
    """Writes one frame's pictures to OUT/previews."""
    points = points_of(cloud)
    view = draw_cloud(points, title=f"{name}: {len(points)} points")
    of_cloud, of_rasters = pictures_of(out, name)
    save_picture(of_cloud, view)
    save_picture(of_rasters, simulated_picture(image, painted, title=name))


def write_simulated(out: Path, dataset: Dataset, positions: Sequence[int], *, run: str) -> Path:
    """Writes OUT/clouds.html, which turns the polar frames in OUT/polar of these places in the data set, beside their
    measured clouds where there are some; `run` names the sensor. Gives the page."""
    frames = open_polar_frames(out / "polar")
    scenes = []
    for position in positions:
        frame = dataset[position]
        simulated = points_of(polar_to_points(frames.read(frame.name)[0], frames.grid))
        measured = np.zeros((0, 4), np.float32) if frame.cloud is None else points_of(frame.cloud)
        scenes.append(compared_clouds(frame.name, simulated, measured))
    beside = any(len(scene.sides) > 1 for scene in scenes)
    both = "Left of the slider the simulated cloud, in the camera's view; right of it the measured one."
    return write_clouds(
        out / CLOUDS_PAGE,
        scenes,
        title="jaxsim simulate",
        sentence=f"The sensor of {run}, simulated{' beside what was measured' if beside else ''}.",
        words=both if beside else "The simulated cloud, in the camera's view.",
    )


def write_detected(
    folder: CloudFolder, files: Sequence[Path], out: Path, *, experiment: DetectorExperiment, sentence: str
) -> Path:
    """Writes pictures of these clouds of a folder to OUT/pictures, and OUT/clouds.html, which turns them; `sentence`
    says what was looked for. Gives the page.

    What was found is read from OUT/results, so that a resumed command draws the same.
    """
    scenes = [_drawn(folder, file, out, experiment=experiment) for file in files]
    words = "Found boxes are orange, labelled ones green; the crossed side is the front."
    return write_clouds(out / CLOUDS_PAGE, scenes, title="jaxsim detect", sentence=sentence, words=words)


def is_drawn(folder: CloudFolder, files: Sequence[Path], out: Path) -> bool:
    """Whether all that `write_detected` writes is there."""
    paths = (path for file in files for path in _pictures(folder, file, out))
    return (out / CLOUDS_PAGE).is_file() and all(path.is_file() for path in paths)


def _pictures(folder: CloudFolder, file: Path, out: Path) -> list[Path]:
    """Where the pictures of a cloud lie: from above and, where the folder has images, on its image."""
    kinds = ("above", "image") if folder.images else ("above",)
    return [out / "pictures" / f"{file.stem}_{kind}.png" for kind in kinds]


def _drawn(folder: CloudFolder, file: Path, out: Path, *, experiment: DetectorExperiment) -> TurnedScene:
    name, points = file.stem, read_points(file)
    view, detected = folder.view(name), folder.detected(name, out / "results")
    labelled = folder.labelled(name, view, experiment.detector.anchors.kind)
    drawn = {"detected": detected.boxes, "score": detected.score, "labelled": labelled, "title": name}
    pictures = [draw_above(points, experiment.voxels.range_m, **drawn)]
    if folder.images:
        pictures.append(draw_on_image(folder.image(name), view, **drawn))
    for path, picture in zip(_pictures(folder, file, out), pictures, strict=True):
        save_picture(path, picture)
    return cloud_with_boxes(name, points, detected=detected.boxes, labelled=labelled)
