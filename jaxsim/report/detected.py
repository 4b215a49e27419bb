"""What a detector found in a folder of clouds, as pictures and as a page that turns the clouds."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from jaxsim.config import DetectorExperiment
from jaxsim.evaluate.cloud_folder import CloudFolder, read_points
from jaxsim.report.boxes import draw_above, draw_on_image
from jaxsim.report.pictures import save_picture
from jaxsim.report.scenes import CLOUDS_PAGE, TurnedScene, cloud_with_boxes, write_clouds


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


def _drawn(folder: CloudFolder, file: Path, out: Path, *, experiment: DetectorExperiment) -> TurnedScene:
    name, points = file.stem, read_points(file)
    view, detected = folder.view(name), folder.detected(name, out / "results")
    labelled = folder.labelled(name, view, experiment.detector.anchors.kind)
    drawn = {"detected": detected.boxes, "score": detected.score, "labelled": labelled, "title": name}
    pictures = {"above": draw_above(points, experiment.voxels.range_m, **drawn)}
    if folder.images:
        pictures["image"] = draw_on_image(folder.image(name), view, **drawn)
    for kind, picture in pictures.items():
        save_picture(out / "pictures" / f"{name}_{kind}.png", picture)
    return cloud_with_boxes(name, points, detected=detected.boxes, labelled=labelled)
