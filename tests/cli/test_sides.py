"""`jaxsim discover RUN`: a run's frames beside the scans that it should imitate. The run is not trained: what is
tested is what lies in the two folders."""

import json
from dataclasses import replace
from pathlib import Path

import jax
import numpy as np
import pytest

from jaxsim.cli import discover, stop_on_error
from jaxsim.cli.flags import DataSource
from jaxsim.cli.sides import Sides
from jaxsim.data import open_dataset
from jaxsim.data.polar_frames import frame_names, read_frame, read_grid, write_frame
from jaxsim.discover import discover_folders
from jaxsim.discover.read import read_comparison
from jaxsim.frame import PolarImage
from jaxsim.pairs.prepared import prepared
from jaxsim.simulate.discover_sides import comparable, measured_in
from jaxsim.simulate.learned_sensor import load
from tests.report import results
from tests.untrained import tiny_experiment, untrained_run

pytestmark = pytest.mark.long

FRAMES = "0,4,8"
"""Of three streets."""


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    """A run on the embedded world that has saved its first, random, generator."""
    folder = tmp_path_factory.mktemp("runs") / "tiny"
    return untrained_run(folder, tiny_experiment(train="0", validation=FRAMES, cache=folder.parent / "cache"))


@pytest.fixture(scope="module")
def out(run: Path, tmp_path_factory) -> Path:
    """The folders that the command makes of the run's validation frames."""
    out = tmp_path_factory.mktemp("out")
    Sides(run=run, out=out).folders()
    return out


def complaint(command: discover.Discover) -> str:
    with pytest.raises(SystemExit) as stop, stop_on_error():
        command()
    return str(stop.value)


def test_both_folders_hold_the_same_frames_on_the_runs_window(run: Path, out: Path):
    window, _ = load(run).window
    for folder in (out / "simulated", out / "measured"):
        grid, about = read_grid(folder)
        np.testing.assert_allclose(grid.elevation_rad, window.elevation_rad, atol=1e-6)
        np.testing.assert_allclose(grid.azimuth_rad, window.azimuth_rad, atol=1e-6)
        np.testing.assert_allclose(grid.origin_m, window.origin_m, atol=1e-5)
        assert sorted(about) == frame_names(folder)
        assert all({*entry} == {"scene", "time", "speed", "heading"} for entry in about.values())
        assert len({entry["speed"] for entry in about.values()}) == 3
    compared = read_comparison(out / "simulated", out / "measured")
    assert len(set(compared.scenes)) == len(compared.names) == 3


def test_measured_frames_are_the_scans_that_the_run_is_trained_on(run: Path, out: Path):
    experiment = load(run).run.experiment
    pairs = prepared(open_dataset(experiment.data), [0, 4, 8], experiment.data, prepare=experiment.prepare)
    for name, pair in zip(pairs.names, pairs, strict=True):
        measured, _ = read_frame(out / "measured", name)
        counts = pair.measured.valid & (pair.measured.intensity >= 0.005) & pair.painted.valid
        np.testing.assert_array_equal(measured.valid, counts)
        np.testing.assert_allclose(measured.range_m[counts], pair.measured.range_m[counts], rtol=1e-5)
        np.testing.assert_array_equal(measured.intensity[counts], pair.measured.intensity[counts])


def test_simulated_frames_say_what_lies_under_a_ray_also_where_it_is_dropped(run: Path, out: Path):
    experiment = load(run).run.experiment
    pairs = prepared(open_dataset(experiment.data), [0], experiment.data, prepare=experiment.prepare)
    image, more = read_frame(out / "simulated", pairs.names[0])
    painted = pairs[0].painted
    assert set(more) == {"semantic", "instance", "rgb", "incidence"}
    np.testing.assert_allclose(image.range_m[image.valid], painted.range_m[image.valid], rtol=1e-5)
    assert not (image.valid & ~painted.valid).any()
    np.testing.assert_array_equal(more["semantic"], painted.semantic)
    known = pairs[0].incidence_rad < np.pi / 2
    np.testing.assert_allclose(more["incidence"][known], pairs[0].incidence_rad[known], atol=1e-4)


def test_a_return_that_rounds_to_zero_counts_as_lost():
    intensity = np.array([[0.0, 0.004, 0.005, 0.3]], np.float32)
    image = PolarImage(np.full((1, 4), 9.0, np.float32), intensity, np.ones((1, 4), bool))
    assert comparable(image, np.array([[True, True, True, False]])).valid.tolist() == [[False, False, True, False]]


def test_a_scan_without_laser_lines_cannot_be_compared(run: Path):
    sensor = load(run)
    frame = open_dataset(sensor.run.experiment.data)[0]
    with pytest.raises(ValueError, match="no laser lines"):
        measured_in(sensor.window, replace(frame, cloud=frame.cloud.replace(row=None)), lines=64)


def test_the_command_compares_what_it_wrote(run: Path, tmp_path: Path, monkeypatch, capsys):
    seen = []

    def answer(*, simulated, measured, known, control, nulls, every_frame, log):
        assert not known.effects
        assert (nulls, every_frame) == (7, False)
        seen.extend([simulated, measured, *read_comparison(simulated, measured).names])
        return results.none()

    monkeypatch.setattr("jaxsim.discover.discover_folders", answer)
    command = discover.Discover(run=run, out=tmp_path, frames="4", nulls=7)
    command()
    command()
    name = open_dataset("synthetic").name_of(4)
    assert seen == [tmp_path / "simulated", tmp_path / "measured", name] * 2
    assert json.loads((tmp_path / "verdict.json").read_text())["verdict"] == "none"
    assert "1 of 1 frames simulated" in capsys.readouterr().out
    text = complaint(replace(command, frames="8"))
    assert f"simulated holds other frames ({name}" in text
    assert "give another --out" in text


def test_a_run_and_folders_at_once(run: Path, out: Path, tmp_path: Path):
    both = discover.Discover(run=run, measured=out / "measured", out=tmp_path)
    assert "give it or two folders, not both" in complaint(both)


def test_flags_of_a_run_without_one(out: Path, tmp_path: Path):
    both = {"simulated": out / "simulated", "measured": out / "measured"}
    assert "--frames is for a trained run" in complaint(discover.Discover(**both, frames="3", out=tmp_path))
    assert "--data.kind is for a trained run" in complaint(
        discover.Discover(**both, data=DataSource("kitti_raw"), out=tmp_path)
    )


def test_one_folder_alone(out: Path, tmp_path: Path):
    assert "--simulated is missing" in complaint(discover.Discover(measured=out / "measured", out=tmp_path))


def test_lamberts_law_stands_for_the_simulator(out: Path, tmp_path: Path, monkeypatch):
    seen = []

    def answer(*, simulated, measured, **_):
        seen.extend([simulated, measured])
        return results.none()

    monkeypatch.setattr("jaxsim.discover.discover_folders", answer)
    discover.Discover(measured=out / "measured", lambert=True, out=tmp_path)()
    assert seen == [tmp_path / "simulated", out / "measured"]
    assert frame_names(tmp_path / "simulated") == frame_names(out / "measured")


@pytest.mark.parametrize(
    ("flags", "words"),
    [
        ({"simulated": Path("simulated"), "measured": Path("measured")}, "leave one of them out"),
        ({"run": Path("runs/x")}, "leave one of them out"),
        ({}, "--measured is missing"),
        ({"measured": Path("recording.pcap")}, "recording.pcap is no folder"),
        ({"measured": Path("measured"), "unpaired": True}, "--lambert came with --unpaired"),
    ],
)
def test_lamberts_law_beside_another_simulator_or_without_measured_frames(tmp_path: Path, flags, words):
    assert words in complaint(discover.Discover(out=tmp_path, lambert=True, **flags))


def test_frames_that_the_data_set_does_not_have(run: Path, tmp_path: Path):
    assert "'x' is no frame number" in complaint(discover.Discover(run=run, frames="x", out=tmp_path))


@pytest.mark.slow
def test_another_gain_for_every_beam_is_found_beside_a_run(tmp_path: Path):
    """The run that travels with the package: an untrained network has no contrast that a sensor's gains would leave."""
    Sides(run=Path("embedded"), out=tmp_path, frames="0-47:4").folders()
    rng = np.random.default_rng(0)
    gain = rng.normal(0, 0.3, len(read_grid(tmp_path / "simulated")[0].elevation_rad))
    # The sensor is the run itself with gains: then nothing else is missing.
    for name in frame_names(tmp_path / "simulated"):
        image, _ = read_frame(tmp_path / "simulated", name)
        noise = rng.normal(0, 0.03, image.intensity.shape)
        bright = np.clip(0.5 * image.intensity * np.exp(gain[:, None] + noise), 0, 1).astype(np.float32)
        write_frame(tmp_path / "measured", name, image.replace(intensity=bright))
    with jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"):
        result = discover_folders(
            simulated=tmp_path / "simulated", measured=tmp_path / "measured", effects=("beam_gain", "range_falloff")
        )
    assert [effect.name for effect in result.verdict.effects] == ["beam_gain"]
    found = np.asarray(dict(result.effects_model.effects)["beam_gain"]["gain"])
    assert np.corrcoef(found, gain)[0, 1] > 0.9
