import importlib
import json

import pytest
from pydantic import TypeAdapter

from jaxsim.config import DepthExperiment, DetectorExperiment, Experiment
from jaxsim.runs.kinds import KINDS, DepthRun, DetectorRun, kind_in, kind_of
from jaxsim.runs.run import load_run, start_run


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.key)
def test_an_experiment_its_settings_and_its_builder_are_of_one_kind(kind):
    experiment = kind.experiment()
    assert kind_of(experiment) is kind
    settings = TypeAdapter(kind.experiment).dump_python(experiment, mode="json")
    assert kind_in(settings) is kind_in({"experiment": settings, "version": "0"}) is kind
    module, _, builder = kind.builder.partition(":")
    assert callable(getattr(importlib.import_module(module), builder))


def test_a_run_is_not_taken_for_one_of_another_kind(tmp_path):
    start_run(tmp_path / "detector", DetectorRun(DetectorExperiment(), 10, 4))
    start_run(tmp_path / "depth", DepthRun(DepthExperiment()))
    assert load_run(tmp_path / "depth", DepthRun) == DepthRun(DepthExperiment())
    with pytest.raises(ValueError, match=r"depth is the run of a depth completion network, not of a detector; name an"):
        load_run(tmp_path / "depth", DetectorRun)
    with pytest.raises(ValueError, match="is the run of a detector, not of an intensity network"):
        load_run(tmp_path / "detector")


def test_a_depth_run_is_its_experiment_alone_as_ever(tmp_path):
    start_run(tmp_path, DepthRun(DepthExperiment()))
    content = json.loads((tmp_path / "config.json").read_text())
    assert content == TypeAdapter(DepthExperiment).dump_python(DepthExperiment(), mode="json")


def test_what_is_no_experiment_is_of_no_kind(tmp_path):
    with pytest.raises(ValueError, match="none of generator, detector, penet"):
        kind_in({"experiment": {"optim": {}}})
    (tmp_path / "config.json").write_text("{}")
    with pytest.raises(ValueError, match=r"is no run's config\.json"):
        load_run(tmp_path)
    assert kind_of(Experiment()).run is not DetectorRun
