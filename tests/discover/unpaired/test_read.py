"""Two folders of different streets."""

import inspect
import shutil
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.blind.hidden.streets import make_unpaired
from jaxsim.data.polar_frames import frame_names, read_frame, read_grid, write_frame, write_grid
from jaxsim.discover import read
from jaxsim.discover.unpaired.read import _bent_by_rounding, read_unpaired, roughness_m
from tests.discover.unpaired.made import SMALL


def test_noise_of_ranges_is_read_off_planes():
    rng = np.random.default_rng(0)
    azimuth = np.linspace(-0.5, 0.5, 200)
    wall = np.broadcast_to(10 / np.cos(azimuth), (50, 200))
    noisy = wall + rng.normal(0, 0.02, wall.shape)
    assert roughness_m(noisy, np.ones(wall.shape, bool)) == pytest.approx(0.02, rel=0.05)
    assert roughness_m(wall, np.ones(wall.shape, bool)) < 1e-3


def test_what_is_dark_beside_a_coarse_lattice_is_compared_on_neither_side(tmp_path, standard_promotion):
    folder = tmp_path / "case"
    key = make_unpaired(folder, effect="intensity_quantization", severity=8.0, seed=4, **SMALL)
    step = key.effects[0]["parameters"]["step"]
    comparison = read_unpaired(folder / "simulated", folder / "measured", per_scene=200)
    assert comparison.steps["intensity_quantization"] == pytest.approx(step, rel=1e-3)
    in_steps = np.exp(comparison.log_intensity) / step
    np.testing.assert_allclose(in_steps, np.round(in_steps), atol=0.01)
    lowest = [in_steps[comparison.measured[comparison.scene] == side].min() for side in (False, True)]
    assert lowest[0] == pytest.approx(lowest[1], abs=0.01)
    assert lowest[0] > 1.5


@pytest.mark.parametrize(("readings", "dark"), [([0, 0.1, 0.2, 0.6, 0.7], 0.35), ([0, 0.1, 0.1, 0.1, 0.2], 0.075)])
def test_a_quarter_of_the_rounded_readings_stay_however_dark_they_are(readings, dark):
    side = SimpleNamespace(readings=lambda field: np.array(readings))
    assert inspect.unwrap(_bent_by_rounding)(side, {"intensity_quantization": 0.1}) == pytest.approx(dark)
    assert inspect.unwrap(_bent_by_rounding)(side, {}) == 0


@pytest.fixture(scope="module")
def streets(tmp_path_factory, standard_promotion):
    """Folders of different streets in which nothing is hidden."""
    folder = tmp_path_factory.mktemp("unpaired") / "case"
    make_unpaired(folder, effect="none", seed=4, **SMALL)
    return folder


@pytest.fixture
def sides(streets, tmp_path):
    """The two folders, to be changed."""
    return [Path(shutil.copytree(streets / side, tmp_path / side)) for side in ("simulated", "measured")]


def rewritten(folder, change):
    """Writes all frames of a folder anew, with their image changed."""
    for name in frame_names(folder):
        image, rasters = read_frame(folder, name)
        write_frame(folder, name, change(image), **rasters)


def test_frames_of_one_drive_without_scenes_are_refused(sides):
    simulated, measured = sides
    grid, about = read_grid(measured)
    write_grid(measured, grid, frames={name: {"time": 0.5 * k} for k, name in enumerate(about)})
    with pytest.raises(ValueError, match=r"measured frames have no scene .* 0\.5 s apart: frames of one drive"):
        read_unpaired(simulated, measured)
    # Without times nothing tells that they are of one drive, and a note says what they count as.
    write_grid(measured, grid)
    notes = read_unpaired(simulated, measured, per_scene=100).notes
    assert any(note.startswith("measured side: ") and "count as a drive each" in note for note in notes)


def test_sides_that_cannot_be_compared_are_refused(sides):
    simulated, measured = sides
    with pytest.raises(ValueError, match=r"tell the incidence of every ray.*exchange --measured and --simulated"):
        read_unpaired(measured, simulated)
    first, second = frame_names(measured)[:2]
    was = {name: read_frame(measured, name) for name in (first, second)}
    write_frame(measured, second, was[first][0], **was[first][1])
    with pytest.raises(ValueError, match=f"{first} and {second} of .* hold the same readings"):
        read_unpaired(simulated, measured)
    write_frame(measured, second, was[second][0], **was[second][1])
    rewritten(measured, lambda image: image.replace(intensity=np.where(image.valid, 0.3, 0).astype(np.float32)))
    with pytest.raises(ValueError, match=r"measured intensity is 0\.3 everywhere"):
        read_unpaired(simulated, measured)


def test_flat_simulated_intensities_and_other_units_are_told(sides):
    simulated, measured = sides
    rewritten(simulated, lambda image: image.replace(intensity=np.where(image.valid, 0.5, 0).astype(np.float32)))
    rewritten(measured, lambda image: image.replace(range_m=image.range_m / np.float32(0.3048)))
    notes = read_unpaired(simulated, measured, per_scene=100).notes
    assert any(note.startswith("simulated intensity is 0.5 everywhere") for note in notes)
    assert any("m below the measured one: ranges in another unit" in note for note in notes)


def test_folders_too_large_for_memory_are_read_in_part(streets, monkeypatch):
    monkeypatch.setattr(read, "FEWEST_FRAMES", 9)
    monkeypatch.setattr(read, "MOST_CELLS", 0)
    comparison = read_unpaired(streets / "simulated", streets / "measured", per_scene=100)
    assert comparison.frames == (9, 9)
    assert any("9 of" in note and "measured frames were read" in note for note in comparison.notes)
