"""Pictures of a cloud from above and of an image, with boxes on them."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import Float, Float32

from jaxsim.detect.results import NEAR_M, Detected
from jaxsim.detect.scenes import Scene, View
from jaxsim.geometry.boxes import corners_of
from jaxsim.report.pictures import FOUND, LABEL, LIGHT_INK, Rgb

BOX_EDGES = [(k, (k + 1) % 4) for k in range(4)]
BOX_EDGES += [(a + 4, b + 4) for a, b in BOX_EDGES] + [(k, k + 4) for k in range(4)]


def draw_above(
    points: Float32[np.ndarray, "n 4"],
    range_m: tuple[float, ...],
    *,
    detected: Float[np.ndarray, "d 7"],
    score: Float[np.ndarray, " d"],
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
    for boxes, colour in ((labelled, LABEL), (detected, FOUND)):
        for k, box in enumerate(boxes if boxes is not None else ()):
            corners = pixels(corners_of(box[None])[0, :4, :2])
            middle, front = pixels(box[:2]), (corners[0] + corners[1]) / 2
            for a, b in [*((corners[i], corners[j]) for i, j in BOX_EDGES[:4]), (middle, front)]:
                cv2.line(picture, _point(a), _point(b), colour, 1, cv2.LINE_AA, 4)
            if boxes is detected:
                at = (int(corners[:, 0].max()) + 3, int(corners[:, 1].min()))
                cv2.putText(picture, f"{score[k]:.2f}", at, cv2.FONT_HERSHEY_SIMPLEX, 0.4, colour, 1, cv2.LINE_AA)
    _legend(picture, title, labelled is not None, has_found=len(detected) > 0)
    return picture


def detection_picture(scene: Scene, detected: Detected, range_m: tuple[float, ...], *, title: str) -> Rgb:
    """A scene from above with what was found in it and what is labelled."""
    labelled = scene.boxes[scene.target] if scene.labels is not None else None
    title = f"{scene.name} {title}".strip()
    return draw_above(
        scene.points, range_m, detected=detected.boxes, score=detected.score, labelled=labelled, title=title
    )


def draw_on_image(
    image: Rgb,
    view: View,
    *,
    detected: Float[np.ndarray, "d 7"],
    score: Float[np.ndarray, " d"],
    labelled: Float[np.ndarray, "g 7"] | None = None,
    title: str = "",
) -> Rgb:
    """An image with the edges of boxes that lie ahead of the camera, the front crossed."""
    picture = image.copy()
    for boxes, colour in ((labelled, LABEL), (detected, FOUND)):
        for k, box in enumerate(boxes if boxes is not None else ()):
            cam = corners_of(box[None])[0] @ view.cam_from_velo[:3, :3].T + view.cam_from_velo[:3, 3]
            if (cam[:, 2] < NEAR_M).any():
                continue
            pixel = cam @ view.intrinsics.T
            # Clipped: sixteenths of a pixel of a corner far outside the image would not fit OpenCV's integers.
            uv = np.clip(pixel[:, :2] / pixel[:, 2:], -10000, 10000)
            for a, b in [*BOX_EDGES, (0, 5), (1, 4)]:
                cv2.line(picture, _point(uv[a]), _point(uv[b]), colour, 1, cv2.LINE_AA, 4)
            if boxes is detected:
                at = (int(uv[:, 0].min()), max(int(uv[:, 1].min()) - 4, 10))
                cv2.putText(picture, f"{score[k]:.2f}", at, cv2.FONT_HERSHEY_SIMPLEX, 0.45, colour, 1, cv2.LINE_AA)
    _legend(picture, title, labelled is not None)
    return picture


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
