"""Clouds as pictures, and as a page that turns them: simulated ones beside what was measured, and those that a detector
has looked at with what it found: boxes from above, and on the image."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float, Float32

from jaxsim.cloud import points_of
from jaxsim.config import DetectorExperiment
from jaxsim.data import Dataset
from jaxsim.data.polar_frames import open_polar_frames
from jaxsim.detect.results import NEAR_M, Detected
from jaxsim.detect.scenes import Scene, View
from jaxsim.evaluate.cloud_folder import CloudFolder, read_points
from jaxsim.frame import Cloud, Painted, PolarImage
from jaxsim.geometry import polar_to_points
from jaxsim.geometry.boxes import corners_of
from jaxsim.report.pictures import FOUND, LABEL, LIGHT_INK, Rgb, draw_cloud, save_picture, simulated_picture
from jaxsim.report.scenes import CLOUDS_PAGE, TurnedScene, cloud_with_boxes, compared_clouds, write_clouds
from jaxsim.simulate.folder import pictures_of

BOX_EDGES = [(k, (k + 1) % 4) for k in range(4)]
BOX_EDGES += [(a + 4, b + 4) for a, b in BOX_EDGES] + [(k, k + 4) for k in range(4)]
_Outline = tuple[list[tuple[np.ndarray, np.ndarray]], tuple[int, int] | None]
"""A box's lines and where its score stands, pixels; None where it is not seen."""


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
    drawn = {"detected": detected, "labelled": labelled, "title": name}
    pictures = [draw_above(points, experiment.voxels.range_m, **drawn)]
    if folder.images:
        pictures.append(draw_on_image(folder.image(name), view, **drawn))
    for path, picture in zip(_pictures(folder, file, out), pictures, strict=True):
        save_picture(path, picture)
    return cloud_with_boxes(name, points, detected=detected.boxes, labelled=labelled)


def draw_above(
    points: Float32[np.ndarray, "n 4"],
    range_m: tuple[float, ...],
    *,
    detected: Detected,
    labelled: Float[np.ndarray, "g 7"] | None = None,
    title: str = "",
    height: int = 900,
) -> Rgb:
    """A cloud from above, driving direction up, coloured by height; boxes with a line to their front.

    `range_m` is x, y, z from, then to, in metres.
    """
    x0, y0, z0, x1, y1, z1 = range_m
    scale = height / (x1 - x0)
    picture = np.full((height, round((y1 - y0) * scale), 3), 12, np.uint8)

    def pixels(xy: np.ndarray) -> np.ndarray:
        return np.stack([(y1 - xy[..., 1]) * scale, (x1 - xy[..., 0]) * scale], axis=-1)

    uv = np.floor(pixels(points[:, :2])).astype(int)
    inside = ((uv >= 0) & (uv < [picture.shape[1], height])).all(axis=1)
    shade = np.clip((points[inside, 2] - z0) / (z1 - z0), 0, 1)
    colours = cv2.applyColorMap(np.arange(256, dtype=np.uint8)[:, None], cv2.COLORMAP_VIRIDIS)[:, 0, ::-1]
    picture[uv[inside, 1], uv[inside, 0]] = colours[(40 + 200 * shade).astype(np.uint8)]

    def outline(box: Float[np.ndarray, " 7"]) -> _Outline:
        corners = pixels(corners_of(box[None])[0, :4, :2])
        to_front = (pixels(box[:2]), (corners[0] + corners[1]) / 2)
        lines = [*((corners[a], corners[b]) for a, b in BOX_EDGES[:4]), to_front]
        return lines, (int(corners[:, 0].max()) + 3, int(corners[:, 1].min()))

    _draw_boxes(picture, outline, detected=detected, labelled=labelled, size=0.4)
    _legend(picture, title, labelled is not None, has_found=len(detected.boxes) > 0)
    return picture


def detection_picture(scene: Scene, detected: Detected, range_m: tuple[float, ...], *, title: str) -> Rgb:
    """A scene from above with what was found in it and what is labelled."""
    labelled = scene.boxes[scene.target] if scene.labels is not None else None
    title = f"{scene.name} {title}".strip()
    return draw_above(scene.points, range_m, detected=detected, labelled=labelled, title=title)


def draw_on_image(
    image: Rgb,
    view: View,
    *,
    detected: Detected,
    labelled: Float[np.ndarray, "g 7"] | None = None,
    title: str = "",
) -> Rgb:
    """An image with the edges of boxes that lie ahead of the camera, the front crossed."""

    def outline(box: Float[np.ndarray, " 7"]) -> _Outline:
        cam = corners_of(box[None])[0] @ view.cam_from_velo[:3, :3].T + view.cam_from_velo[:3, 3]
        if (cam[:, 2] < NEAR_M).any():
            return [], None
        pixel = cam @ view.intrinsics.T
        # Clipped: sixteenths of a pixel of a corner far outside the image would not fit OpenCV's integers.
        uv = np.clip(pixel[:, :2] / pixel[:, 2:], -10000, 10000)
        lines = [(uv[a], uv[b]) for a, b in [*BOX_EDGES, (0, 5), (1, 4)]]
        return lines, (int(uv[:, 0].min()), max(int(uv[:, 1].min()) - 4, 10))

    picture = image.copy()
    _draw_boxes(picture, outline, detected=detected, labelled=labelled, size=0.45)
    _legend(picture, title, labelled is not None)
    return picture


def _draw_boxes(
    picture: Rgb,
    outline: Callable[[np.ndarray], _Outline],
    *,
    detected: Detected,
    labelled: Float[np.ndarray, "g 7"] | None,
    size: float,
) -> None:
    """Draws the outline of each box, labelled ones first; beside what was found its score, in letters of this size."""
    found = [(box, f"{score:.2f}") for box, score in zip(detected.boxes, detected.score, strict=True)]
    known = [(box, "") for box in labelled] if labelled is not None else []
    for boxes, colour in ((known, LABEL), (found, FOUND)):
        for box, score in boxes:
            lines, at = outline(box)
            for a, b in lines:
                cv2.line(picture, _point(a), _point(b), colour, 1, cv2.LINE_AA, 4)
            if score and at:
                cv2.putText(picture, score, at, cv2.FONT_HERSHEY_SIMPLEX, size, colour, 1, cv2.LINE_AA)


def _point(at: Sequence[float] | np.ndarray) -> tuple[int, int]:
    """Sixteenths of a pixel, as OpenCV's lines take them."""
    return round(float(at[0]) * 16), round(float(at[1]) * 16)


def _legend(picture: Rgb, title: str, has_labels: bool, *, has_found: bool = True) -> None:
    words = [(title, LIGHT_INK)] + [("found", FOUND)] * has_found + [("labelled", LABEL)] * has_labels
    words = [(word, colour) for word, colour in words if word]
    widths = [cv2.getTextSize(word, cv2.FONT_HERSHEY_SIMPLEX, 0.5, 1)[0][0] + 18 for word, _ in words]
    picture[:28, : sum(widths) + 4] //= 4
    x = 10
    for (word, colour), width in zip(words, widths, strict=True):
        cv2.putText(picture, word, (x, 20), cv2.FONT_HERSHEY_SIMPLEX, 0.5, colour, 1, cv2.LINE_AA)
        x += width
