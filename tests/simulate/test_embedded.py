"""The sensor that travels with the package is whole, says when it is not, and simulates."""

from dataclasses import replace
from pathlib import Path

import jax
import numpy as np
import pytest

import jaxsim
from configs.embedded import experiment
from jaxsim.simulate.embedded import FILES, FOLDER, SUMS_FILE, folder_of, is_embedded, read_embedded
from jaxsim.simulate.grain import read_grain
from tests.untrained import untrained_run

SMALL = replace(experiment, generator=replace(experiment.generator, filters=4, max_filters=8, downsamples=1))


def test_it_is_the_experiment_of_configs_and_weighs_less_than_five_megabytes():
    run, parameters = read_embedded()
    assert run.experiment == experiment
    assert all(leaf.dtype == np.float32 and np.isfinite(leaf).all() for leaf in jax.tree.leaves(parameters))
    assert sum(path.stat().st_size for path in FOLDER.iterdir() if path.is_file()) < 5e6
    assert "jaxsim train embedded" in (FOLDER / "card.md").read_text()


def test_its_name_loads_it_unless_a_run_lies_there(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert is_embedded("embedded")
    assert not is_embedded("runs/embedded")
    assert read_grain(folder_of(Path("embedded"))).fingerprint == read_grain(FOLDER).fingerprint
    assert jaxsim.load("embedded").fingerprint == jaxsim.load("embedded").fingerprint
    untrained_run(tmp_path / "embedded", SMALL)
    assert not is_embedded("embedded")
    assert folder_of(Path("embedded")) == Path("embedded")
    assert jaxsim.load("embedded").run.experiment.generator.filters == 4


@pytest.mark.parametrize("name", [*FILES, SUMS_FILE])
def test_a_damaged_installation_says_so(tmp_path, name):
    for file in (*FILES, SUMS_FILE):
        (tmp_path / file).write_bytes((FOLDER / file).read_bytes())
    (tmp_path / name).write_bytes((tmp_path / name).read_bytes()[:-70])
    with pytest.raises(ValueError, match="pip install --force-reinstall"):
        read_embedded(tmp_path)
    (tmp_path / name).unlink()
    with pytest.raises(ValueError, match=f"{name} not in .*pip install --force-reinstall"):
        read_embedded(tmp_path)
