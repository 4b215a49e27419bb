"""`jaxsim detect` on real scans with a tiny detector that never trained, and its errors."""

import json
import shutil
from dataclasses import replace

import cv2
import numpy as np
import pytest

from jaxsim.cli.detect import Detect
from jaxsim.detect.results import Detected
from jaxsim.detect.steps import create_state
from jaxsim.evaluate.detector import load_detector
from jaxsim.metrics.detection import read_detections
from jaxsim.runs.kinds import DetectorRun
from jaxsim.runs.run import Checkpoints, start_run
from jaxsim.simulate.learned_sensor import load
from tests.detect.tiny import EXPERIMENT

UNTRAINED = replace(EXPERIMENT, detector=replace(EXPERIMENT.detector, score=0.0))


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    start_run(folder, DetectorRun(UNTRAINED, 10, 8))
    state = create_state(UNTRAINED, 10, seed=0)
    Checkpoints(folder, keep=1).save(10, state=state, network=state.network)
    return folder


@pytest.fixture
def kitti(samples):
    return samples / "kitti_object" / "training"


@pytest.mark.long
def test_real_scans_give_result_files_and_pictures(run, kitti, tmp_path):
    clouds = tmp_path / "clouds"
    clouds.mkdir()
    shutil.copy(kitti / "velodyne" / "000001.bin", clouds)
    out = tmp_path / "out"
    command = Detect(run, clouds, out, kitti / "calib", kitti / "image_2", kitti / "label_2", max_voxels=6000)
    command()
    found = read_detections(out / "results")
    assert found.names == ("000001",)
    assert set(found.kind) <= {"Car"}
    assert len(found.score)
    assert ((found.bbox_px[:, :2] >= 0) & (found.bbox_px[:, 2:] <= [1241, 374])).all()
    picture = cv2.imread(str(out / "pictures" / "000001_image.png"))
    assert picture.shape == (375, 1242, 3)
    assert cv2.imread(str(out / "pictures" / "000001_above.png")) is not None

    page = (out / "clouds.html").read_text()

    # What is there is not made again.
    path = out / "results" / "000001.txt"
    path.write_text("")
    command()
    assert path.read_text() == ""
    assert (out / "clouds.html").read_text() == page


def test_pictures_and_page_of_a_resumed_command_are_those_of_a_whole_one(run, kitti, tmp_path, monkeypatch):
    """Drawn are the first clouds of the folder, not the first that were left to do; and the page shows them all."""
    clouds = tmp_path / "clouds"
    clouds.mkdir()
    points = np.fromfile(kitti / "velodyne" / "000001.bin", "<f4").reshape(-1, 4)
    for name in ("a", "b", "c"):
        points[::9].tofile(clouds / f"{name}.bin")
    boxes = np.array([[10, 2, -1, 4, 2, 1.5, 0.3]], np.float32)

    def finds(finder, network, given, **told):
        for name, _ in given:
            yield name, Detected(boxes + ord(name) % 3, np.array([0.7], np.float32))

    monkeypatch.setattr("jaxsim.evaluate.cloud_folder.find_all", finds)
    whole, cut = tmp_path / "whole", tmp_path / "cut"
    Detect(run, clouds, whole, pictures=2)()
    Detect(run, clouds, cut, pictures=0)()
    for name in ("b", "c"):
        (cut / "results" / f"{name}.txt").unlink()
    Detect(run, clouds, cut, pictures=2)()
    made = sorted(path.relative_to(whole) for path in whole.rglob("*") if path.suffix in (".txt", ".png", ".html"))
    assert len(made) == 3 + 2 + 1
    for path in made:
        assert (cut / path).read_bytes() == (whole / path).read_bytes(), path
    # More of them are drawn where more are asked for, though nothing is left to find.
    Detect(run, clouds, cut, pictures=3)()
    assert (cut / "pictures" / "c_above.png").is_file()


@pytest.fixture
def results(kitti, tmp_path):
    """One scan, and a folder where its result stands: the command has nothing to find."""
    (tmp_path / "clouds").mkdir()
    shutil.copy(kitti / "velodyne" / "000001.bin", tmp_path / "clouds")
    (tmp_path / "out" / "results").mkdir(parents=True)
    return {"clouds": tmp_path / "clouds", "out": tmp_path / "out", "calib": kitti / "calib", "pictures": 0}


def test_results_of_another_making_are_not_taken_for_these(run, results, kitti, tmp_path):
    Detect(run, **results).folder.claim(results["out"], load_detector(run))
    (results["out"] / "results" / "000001.txt").write_text("")
    Detect(run, **results)()
    Detect(run, **results, step=10)()
    moved = tmp_path / "moved"
    shutil.copytree(run, moved)
    Detect(moved, **results)()
    with pytest.raises(ValueError, match=r"settings \(voxels\.max_voxels was 3000, now 500\); give another --out"):
        Detect(run, **results, max_voxels=500)()
    with pytest.raises(ValueError, match=r"calib was .*calib, now None"):
        Detect(run, **results | {"calib": None})()
    with pytest.raises(ValueError, match=r"settings \(clouds was .*clouds, now .*velodyne"):
        Detect(run, **results | {"clouds": kitti / "velodyne"})()
    assert (results["out"] / "results" / "000001.txt").read_text() == ""


def test_results_of_clouds_that_have_changed_since_are_made_anew(run, results, monkeypatch, caplog):
    """Those of a folder of before, which does not say what they were made of, stay."""

    def finds(finder, network, given, **told):
        for name, points in given:
            yield name, Detected(np.float32([[len(points) / 1000, 2, -1, 4, 2, 1.5, 0]]), np.float32([0.9]))

    monkeypatch.setattr("jaxsim.evaluate.cloud_folder.find_all", finds)
    out, clouds = results["out"], results["clouds"]
    results |= {"calib": None}
    shutil.copy(clouds / "000001.bin", clouds / "000002.bin")

    def found() -> list[str]:
        Detect(run, **results)()
        return [(out / f"results/00000{k}.txt").read_text().split()[13] for k in (1, 2)]

    first = found()
    points = np.fromfile(clouds / "000002.bin", "<f4").reshape(-1, 4)
    points[: len(points) // 2].tofile(clouds / "000002.bin")
    second = found()
    assert second == found() == [first[0], f"{len(points) // 2 / 1000:.4f}"]
    assert caplog.messages.count("detect: 000002 made anew: what it was made of has changed since") == 1
    record = json.loads((out / "detect.json").read_text())
    assert {*record.pop("sources")} == {"000001", "000002"}
    (out / "detect.json").write_text(json.dumps(record))
    points.tofile(clouds / "000002.bin")
    assert found() == second


def test_other_weights_or_another_score_limit_are_another_detector(run, results, tmp_path):
    for name, experiment, seed in (("weights", UNTRAINED, 1), ("score", EXPERIMENT, 0)):
        start_run(tmp_path / name, DetectorRun(experiment, 10, 8))
        state = create_state(experiment, 10, seed=seed)
        Checkpoints(tmp_path / name, keep=1).save(10, state=state, network=state.network)
    Detect(run, **results).folder.claim(results["out"], load_detector(run))
    (results["out"] / "results" / "000001.txt").write_text("")
    with pytest.raises(ValueError, match=r"weights was \w+, now \w+\);"):
        Detect(tmp_path / "weights", **results, step=10)()
    with pytest.raises(ValueError, match=r"settings \(detector\.score was 0\.0, now 0\.3\);"):
        Detect(tmp_path / "score", **results)()


def test_results_that_nobody_signed_are_refused(run, results):
    (results["out"] / "results" / "000001.txt").write_text("")
    with pytest.raises(ValueError, match=r"is not empty, and no detect\.json says"):
        Detect(run, **results)()
    (results["out"] / "detect.json").write_text("{")
    with pytest.raises(ValueError, match=r"detect\.json cannot be read"):
        Detect(run, **results)()


@pytest.mark.slow
def test_without_calibration_boxes_are_in_the_lidars_axes_and_have_no_rectangle(run, kitti, tmp_path):
    clouds = tmp_path / "clouds"
    clouds.mkdir()
    points = np.fromfile(kitti / "velodyne" / "000002.bin", "<f4").reshape(-1, 4)
    points = points[np.abs(points[:, 1]) < 0.8 * points[:, 0]]
    np.savez(clouds / "a.npz", xyz=points[:, :3], intensity=points[:, 3])
    Detect(run, clouds, tmp_path / "out", pictures=0, max_voxels=6000)()
    found = read_detections(tmp_path / "out" / "results")
    assert len(found.score)
    assert (found.bbox_px == 0).all()
    # z ahead, x to the right: the tiny range is 25.6 m ahead and 12.8 m to either side.
    assert (np.abs(found.centre_m[:, 0]) < 14).all()
    assert ((found.centre_m[:, 2] > -2) & (found.centre_m[:, 2] < 28)).all()
    assert not (tmp_path / "out" / "pictures").exists()


def test_images_and_labels_need_a_calibration(run, kitti, tmp_path):
    for name in ("images", "labels"):
        with pytest.raises(ValueError, match=f"--{name} needs --calib"):
            Detect(run, kitti / "velodyne", tmp_path, **{name: kitti})()


def test_a_step_that_is_not_kept_is_refused(run):
    with pytest.raises(ValueError, match="no checkpoint of step 7; it keeps 10"):
        load_detector(run, step=7)
    with pytest.raises(ValueError, match="run of a detector, not of an intensity network"):
        load(run)


@pytest.mark.long
def test_one_broken_cloud_costs_itself_alone(run, kitti, tmp_path):
    clouds = tmp_path / "clouds"
    clouds.mkdir()
    for name in ("000001", "000003"):
        shutil.copy(kitti / "velodyne" / "000001.bin", clouds / f"{name}.bin")
    whole = (clouds / "000001.bin").read_bytes()
    (clouds / "000002.bin").write_bytes(whole[:-7])
    command = Detect(run, clouds, tmp_path / "out", max_voxels=1000, pictures=0)
    with pytest.raises(ValueError, match=r"detect: 1 of 3 pieces of work failed, the others are done; .*000002\.bin"):
        command()
    assert [path.stem for path in sorted((tmp_path / "out" / "results").iterdir())] == ["000001", "000003"]
