"""The loop's sensor beside the real one; its trees are tested with the stages."""

import json

import pytest

from jaxsim.data.polar_frames import frame_names
from jaxsim.simulate.trees import LabelRules
from jaxsim.studies.real2sim2real import claim_loop, simulation
from tests.report import results
from tests.studies.real2sim2real.made import tiny_loop
from tests.untrained import untrained_run


@pytest.fixture
def loop(tmp_path):
    return claim_loop(tiny_loop(tmp_path / "loop"))


@pytest.mark.long
def test_the_sensor_is_held_against_frames_that_it_did_not_learn_from(loop, monkeypatch):
    untrained_run(loop.sensor, loop.intensity_experiment())
    compared = {}

    def discover(*, simulated, measured, log):
        compared.update(simulated=frame_names(simulated), measured=frame_names(measured))
        return results.named()

    monkeypatch.setattr(simulation, "discover_folders", discover)
    simulation.discover_lacking(loop)
    assert compared["simulated"] == compared["measured"]
    assert len(compared["simulated"]) == 1  # the validation's
    assert json.loads(loop.effects.read_text())["effects"][0]["name"] == results.named().verdict.effects[0].name
    assert {"verdict.json", "report.html"} <= {path.name for path in loop.effects.parent.iterdir()}


def test_all_kinds_are_planned_and_only_simulated_ones_need_the_sensor(loop, monkeypatch):
    planned = []
    monkeypatch.setattr(simulation, "load", lambda run: pytest.fail("the sensor was loaded"))
    monkeypatch.setattr(simulation, "export_trees", lambda plans, dataset: planned.extend(plans))
    plain = claim_loop(tiny_loop(loop.out.parent / "plain", kinds=("raw_64", "raw_32")))
    simulation.export_kinds(plain)
    assert [plan.out for plan in planned] == [plain.tree("raw_64"), plain.tree("raw_32")]
    assert [plan.recipe.lines for plan in planned] == ["64", "32_of_64"]
    assert all(plan.labels == LabelRules() and plan.effects_model is None for plan in planned)
    assert all(plan.validation == {20} and plan.positions == [0, 8, 20] for plan in planned)
