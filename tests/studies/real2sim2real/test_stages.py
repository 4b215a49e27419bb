"""The loop's stages: all on a tiny scale, with networks that never trained; counts and pictures on made scenes."""

import json
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from jaxsim.data.polar_frames import frame_names
from jaxsim.detect.results import Detected
from jaxsim.effects.chain import SensorModel
from jaxsim.export.plan import LabelRules
from jaxsim.report.pictures import FOUND, LABEL
from jaxsim.studies.real2sim2real import Loop, claim_loop, stages
from jaxsim.studies.real2sim2real.page import PANEL, draw_kinds
from jaxsim.studies.real2sim2real.stages import Stages
from jaxsim.train.experiments import load_loop
from tests.detect.tiny import EXPERIMENT, scene
from tests.report import results
from tests.studies.real2sim2real.made import KINDS, tiny_loop
from tests.untrained import untrained_run

UNTRAINED = """
import sys
from pathlib import Path
import numpy as np
from jaxsim.train import read_experiment
from jaxsim.config import DetectorExperiment
from tests.untrained import untrained_detector, untrained_run
experiment = read_experiment(Path(sys.argv[1]))
folder = Path(experiment.run.out) / experiment.run.name
make = untrained_detector if isinstance(experiment, DetectorExperiment) else untrained_run
make(folder, experiment)
(folder / "card.md").write_text("never trained")
print("trained", folder, flush=True)
"""


class Lacking:
    """In place of `discover`, which takes minutes: finds that the sensor loses rays at random."""

    def __init__(self) -> None:
        self.asked: list[Path] = []

    def __call__(self, loop: Loop) -> None:
        self.asked.append(loop.intensity)
        SensorModel((("random_dropout", {"probability": 0.2}),)).save(loop.effects)
        (loop.effects.parent / "verdict.json").write_text("{}")


def stages_of(loop: Loop, script: Path = Path("train.py"), discover=lambda loop: None) -> Stages:
    return Stages(loop, discover=discover, trainer=(sys.executable, str(script)))


def made(out: Path) -> dict[str, int]:
    """When each file was written, but for tables, page, pictures and lists, which are written anew."""
    told = ("real2sim2real.", "clouds.", "loop.json", ".lock", "export.json", "train.txt", "val.txt", "trainval.txt")
    files = [path for path in out.rglob("*") if path.is_file() and not path.name.startswith(told)]
    return {str(path): path.stat().st_mtime_ns for path in files if path.parent != out / "pictures"}


@pytest.mark.slow
@pytest.mark.usefixtures("quick_programs")
def test_the_whole_loop_is_made_once_and_told_twice(tmp_path, capfd):
    script = tmp_path / "train.py"
    script.write_text(UNTRAINED)
    lacking = Lacking()
    config = tiny_loop(tmp_path / "loop")
    loop = claim_loop(config)
    stages_of(loop, script, lacking).all()
    assert lacking.asked == [loop.intensity]
    said = capfd.readouterr().out
    assert said.count("trained /") == 1 + len(KINDS) + 1
    # What tells the clouds apart is told before the first detector trains.
    assert 0 < said.index("Whole scenes:") < said.index("seed 0: a detector of raw_64 clouds")

    counts = json.loads((loop.out / "clouds.json").read_text())
    assert counts["clouds"] == ["real", *KINDS]
    assert next(iter(counts["classes"])) == "Car"
    points = {kind: row["points"] for kind, row in counts["classes"]["Car"].items()}
    assert all(n > 100 for n in points.values())
    assert points["raw_64"] > points["discovered_grid"]
    plain = json.loads((loop.out / "real2sim2real.json").read_text())
    assert set(plain["clouds"]) == {"real", *KINDS}
    assert {row["clouds"] for row in plain["on_real"]} == {*KINDS, "real"}
    assert {row["clouds"] for row in plain["of_real"]} == set(KINDS)
    assert "found to lack: random_dropout" in (loop.out / "real2sim2real.md").read_text()
    assert "<img" in (loop.out / "real2sim2real.html").read_text()
    drawn = {path.stem for path in (loop.out / "pictures").iterdir()}
    assert {"clouds", "found", "drops", "intensity", "epochs", "on_car", "elsewhere"} <= drawn
    scores = {path.stem for path in (loop.out / "scores/seed0").iterdir()}
    assert scores == {f"{a}_on_{b}" for a, b in loop.judgements}
    for kind in KINDS:
        assert len(list((loop.tree(kind) / "training/velodyne").iterdir())) == 3
        cloud = np.fromfile(next((loop.tree(kind) / "training/velodyne").iterdir()), "<f4").reshape(-1, 4)
        assert (cloud[:, 3] == 0).all() == (kind == "raw_64")

    before = made(loop.out)
    stages_of(claim_loop(config), script, lacking).all()
    assert made(loop.out) == before
    again = capfd.readouterr().out
    assert "trained /" not in again
    assert "Whole scenes:" in again  # of the last report
    assert len(lacking.asked) == 1


@pytest.fixture
def loop(tmp_path):
    config, _ = load_loop("real2sim2real")
    detector = replace(EXPERIMENT, data=config.detector.data)
    return claim_loop(replace(config, detector=detector, out=tmp_path / "loop", kinds=("raw_64", "simulated_64")))


def test_the_clouds_of_training_scenes_are_counted_inside_the_range(loop):
    """Six cars of 160 points each on a road of 1500; whatever lies beyond the range is not there."""
    stages, scenes = stages_of(loop), [scene(seed) for seed in (0, 1)]
    beyond = np.float32([[30, 0, 0, 0.5], [-2, 0, 0, 0.5], [10, 13, 0, 0.5]])
    far = np.float32([[40, 0, -1, 4, 2, 1.5, 0]])
    one = scenes[0]
    labels = replace(
        one.labels,
        **{name: np.concatenate([getattr(one.labels, name), getattr(one.labels, name)[:1]]) for name in ARRAYS},
        kind=(*one.labels.kind, "Van"),
    )
    scenes[0] = replace(
        one,
        points=np.concatenate([one.points, beyond]),
        boxes=np.concatenate([one.boxes, far]),
        target=np.append(one.target, False),
        difficulty=np.append(one.difficulty, 0),
        labels=labels,
    )
    stages.scenes_of["raw_64", "train"] = scenes
    counts = stages.counted("raw_64")
    assert (counts.scenes, counts.points) == (2, 2 * (1500 + 6 * 160))
    on_cars = [n for band in counts.on_objects["Car"].values() for n in band]
    assert len(on_cars) == 12
    assert all(160 <= n < 260 for n in on_cars)  # and the road under it
    assert "Van" not in counts.on_objects
    assert stages.counted("raw_64") is counts


ARRAYS = ("centre_m", "size_m", "yaw_rad", "bbox_px", "truncated", "occluded")


def test_scenes_without_labels_cannot_be_counted(loop):
    stages = stages_of(loop)
    stages.scenes_of["raw_64", "train"] = [replace(scene(0), labels=None)]
    with pytest.raises(ValueError, match="000000 has no labels; choose labelled frames"):
        stages.counted("raw_64")


def count(picture, colour):
    return int((np.abs(picture.astype(int) - colour).max(axis=-1) < 60).sum())


def test_the_frame_with_most_cars_is_drawn_in_every_kind_and_with_what_each_detector_finds(loop, monkeypatch):
    few, many = scene(3, cars=1), scene(4, cars=6)
    scenes = {kind: [few, many] for kind in ("real", "raw_64", "simulated_64")}
    asked = []

    def find(network, points):
        assert points is many.points
        asked.append(network)
        boxes = many.boxes[:2] if network == "real" else many.boxes[:0]
        return Detected(boxes, np.full(len(boxes), 0.9, np.float32)), {}

    module = "jaxsim.studies.real2sim2real.stages"
    monkeypatch.setattr(f"{module}.make_find", lambda experiment: find)
    monkeypatch.setattr(f"{module}.load_detector", lambda run: SimpleNamespace(network=run.name))
    stages = stages_of(loop)
    stages.scenes_of |= {(kind, "validation"): both for kind, both in scenes.items()}
    pictures, turned = stages.shown()
    assert asked == ["raw_64", "simulated_64", "real"]
    assert len(turned) == 3
    width = PANEL + 4  # the tiny range is square
    assert pictures["clouds"].shape == (PANEL + 4, 2 * width, 3)
    assert pictures["found"].shape == (PANEL + 4, 3 * width, 3)
    panels = [pictures["found"][28:, k * width : (k + 1) * width] for k in range(3)]
    assert [count(panel, FOUND) > 50 for panel in panels] == [False, False, True]
    assert all(count(panel, LABEL) > 200 for panel in panels)
    assert count(pictures["clouds"][28:], FOUND) == 0
    assert count(pictures["clouds"][28:, :width], LABEL) > 200


def test_no_frame_in_all_kinds_is_no_picture_of_kinds(loop):
    assert draw_kinds(loop, {"raw_64": [scene(1)], "simulated_64": [scene(2)]}) == {}


@pytest.fixture
def tiny(tmp_path):
    return claim_loop(tiny_loop(tmp_path / "loop"))


@pytest.mark.long
def test_the_sensor_is_held_against_frames_that_it_did_not_learn_from(tiny, monkeypatch):
    untrained_run(tiny.intensity, tiny.intensity_experiment())
    compared = {}

    def discover(*, simulated, measured, log):
        compared.update(simulated=frame_names(simulated), measured=frame_names(measured))
        return results.named()

    monkeypatch.setattr(stages, "discover_folders", discover)
    stages.discover_lacking(tiny)
    assert compared["simulated"] == compared["measured"]
    assert len(compared["simulated"]) == 1  # the validation's
    assert json.loads(tiny.effects.read_text())["effects"][0]["name"] == results.named().verdict.effects[0].name
    assert {"verdict.json", "report.html"} <= {path.name for path in tiny.effects.parent.iterdir()}


def test_all_kinds_are_planned_and_only_simulated_ones_need_the_sensor(tiny, monkeypatch):
    planned = []
    monkeypatch.setattr(stages, "load", lambda run: pytest.fail("the sensor was loaded"))
    monkeypatch.setattr(stages, "export_trees", lambda plans, dataset: planned.extend(plans))
    plain = claim_loop(tiny_loop(tiny.out.parent / "plain", kinds=("raw_64", "raw_32")))
    stages.export_kinds(plain)
    assert [plan.out for plan in planned] == [plain.tree("raw_64"), plain.tree("raw_32")]
    assert [plan.recipe.lines for plan in planned] == ["64", "32_of_64"]
    assert all(plan.labels == LabelRules() and plan.effects_model is None for plan in planned)
    assert all(plan.validation == {20} and plan.positions == [0, 8, 20] for plan in planned)
