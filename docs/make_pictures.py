"""Makes the pictures of the README and the pages: `python docs/make_pictures.py`, or with the names of some."""

import sys
from pathlib import Path

import cv2
import numpy as np

import jaxsim
from jaxsim.cloud import points_of
from jaxsim.data import open_dataset
from jaxsim.data.logs.range_images import read_range_images
from jaxsim.data.polar_frames import open_polar_frames
from jaxsim.detect.batches import inside
from jaxsim.detect.scenes import scene_of_frame
from jaxsim.evaluate.detector import load_detector, make_find
from jaxsim.files import read_arrays
from jaxsim.frame import Cloud
from jaxsim.geometry import polar_to_points
from jaxsim.prepare import prepare_frame
from jaxsim.report.clouds import draw_above, draw_on_image
from jaxsim.report.pictures import beside, colour_scalar, draw_cloud, intensity_panel, pair_picture, save_picture, strip
from jaxsim.simulate.predict import make_predict

PICTURES = Path(__file__).parent / "pictures"


def shrunk(picture: np.ndarray, width: int) -> np.ndarray:
    height = round(len(picture) * width / picture.shape[1])
    return cv2.resize(np.ascontiguousarray(picture), (width, height), interpolation=cv2.INTER_AREA)


def streets() -> None:
    """Four camera views of the embedded world."""
    world = open_dataset("synthetic")
    views = [shrunk(world[i].camera.rgb, 620) for i in (3, 57, 123, 171)]
    picture = np.concatenate([beside(views[:2]), beside(views[2:])])
    save_picture(PICTURES / "streets.jpg", picture)


def sweep() -> None:
    """One measured sweep of the embedded world: intensity by line and azimuth, and the cloud."""
    world = open_dataset("synthetic")
    frame, truth = world[3], world.truth(3)
    panel = intensity_panel(np.asarray(truth.image.intensity), np.asarray(truth.detection) > 0.5)
    ahead = panel[:, panel.shape[1] // 4 : -(panel.shape[1] // 4)]
    cloud = draw_cloud(points_of(frame.cloud), size=(460, 1240), title="measured cloud, coloured by intensity")
    picture = np.concatenate([strip([("half a turn of the true sensor, without noise", ahead)], width=1240), cloud])
    save_picture(PICTURES / "sweep.jpg", picture)


def synthetic() -> None:
    """A validation frame: inputs, prediction, measurement; and the simulated cloud beside the measured one."""
    sensor = jaxsim.load("embedded")
    world = open_dataset(sensor.run.experiment.data)
    pair, grid = prepare_frame(world[1920], world.spec, sensor.run.experiment.prepare)
    says = make_predict(sensor.generate, sensor.run.experiment.prepare)(sensor.params, pair)
    predicted, spread = np.asarray(says.reported), np.asarray(says.quantiles[..., -1] - says.quantiles[..., 0])
    picture = pair_picture(pair, predicted, title=world.name_of(1920), spread=spread)
    save_picture(PICTURES / "synthetic.png", shrunk(picture, 1116))

    def view(cloud: Cloud, title: str) -> np.ndarray:
        points = points_of(cloud)
        return draw_cloud(points, size=(420, 620), title=f"{title}: {len(points)} points")

    seen = pair.painted.valid
    simulated = polar_to_points(pair.measured.replace(range_m=pair.painted.range_m, intensity=predicted,
                                                      valid=seen & (predicted > 0)), grid)  # fmt: skip
    measured = polar_to_points(pair.measured.replace(valid=pair.measured.valid & seen), grid)
    save_picture(PICTURES / "clouds.jpg", beside([view(simulated, "simulated"), view(measured, "measured")]))


def ablation() -> None:
    """A frame of the ablation of inputs (after `python eval.py ablation --train ablation ...`)."""
    picture = cv2.imread("runs/ablation/pictures/synthetic-0-002026.png")
    save_picture(PICTURES / "ablation.jpg", picture[..., ::-1])


def real2sim2real() -> None:
    """What detectors find in a frame (after `jaxsim real2sim2real`)."""
    found = cv2.imread("runs/real2sim2real/pictures/found.png")
    save_picture(PICTURES / "real2sim2real_found.jpg", shrunk(found[..., ::-1], 1400))


def detections() -> None:
    """What the detector of real clouds finds in a street of the embedded world (after `jaxsim real2sim2real`)."""
    detector = load_detector(Path("runs/real2sim2real/detectors/seed0/real"))
    experiment, world = detector.experiment, open_dataset(detector.experiment.data)
    frame = world[2008]  # of those that validate: ten cars
    scene = scene_of_frame(frame, experiment.detector.anchors.kind, in_image=experiment.in_image)
    found, _ = make_find(experiment)(detector.network, scene.points)
    # What lies beyond the range was neither looked for nor scored.
    labelled = scene.boxes[scene.target & inside(scene.boxes, experiment.voxels)]
    boxes = {"detected": found, "labelled": labelled}
    on_image = draw_on_image(np.asarray(frame.camera.rgb), scene.view, **boxes)
    x0, _, z0, x1, _, z1 = experiment.voxels.range_m
    above = draw_above(scene.points, (x0, -11.2, z0, x1, 11.2, z1), **boxes, height=562)
    larger = cv2.resize(on_image, (1863, 562), interpolation=cv2.INTER_CUBIC)
    save_picture(PICTURES / "detections.jpg", shrunk(beside([larger, above]), 1600))


def two_makers() -> None:
    """A real turn and Lambert's law on its ranges (after the commands of docs/bring-yours.md, "Two makers")."""
    measured, simulated = (open_polar_frames(Path(name)) for name in ("ouster", "ouster_answer/simulated"))
    ours, theirs = (frames.read(frames.names[0])[0] for frames in (simulated, measured))
    valid = np.asarray(theirs.valid)
    left = np.log(np.maximum(theirs.intensity, 1e-3)) - np.log(np.maximum(ours.intensity, 1e-3))
    panels = [
        ("OS-2-128, measured reflectivity (0-0.6)", intensity_panel(np.asarray(theirs.intensity), valid)),
        ("the same ranges by Lambert's law (0-0.6)", intensity_panel(np.asarray(ours.intensity), valid)),
        ("ln of measured over simulated (-2 to 2)", colour_scalar(left, valid, low=-2.0, high=2.0)),
    ]
    save_picture(PICTURES / "two_makers.jpg", shrunk(strip(panels, width=1240), 1000))


def grain() -> None:
    """A suburb's scan with simulated intensities (after the segmentation of docs/real2sim2real.md, `--no-grain` to
    runs/segmentation_single)."""
    folder = Path("runs/segmentation")
    image = read_range_images(folder / "images" / "suburb")[3]
    made = Path("intensity") / "part0.npz"
    single = read_arrays(Path("runs/segmentation_single") / made, by="pictures")["intensity"][3]
    together = read_arrays(folder / made, by="pictures")["intensity"][3]
    panels = [
        (words, intensity_panel(intensity[:, 300:800], image.valid[:, 300:800]))
        for words, intensity in (
            ("measured (0-0.6)", image.intensity),
            ("simulated, each cell drawn for itself (0-0.6)", single),
            ("simulated, drawn with the grain of measured rays (0-0.6)", together),
        )
    ]
    save_picture(PICTURES / "grain.jpg", shrunk(strip(panels, width=1240), 1000))


if __name__ == "__main__":
    for name in sys.argv[1:] or ("streets", "sweep", "synthetic"):
        globals()[name]()
