"""Frames that a sensor model made, written to disk, against the sensor that it imitates."""

import json
from pathlib import Path

import jax
import numpy as np
import pytest

from benchmarks.blind.hidden import make_case
from jaxsim.data.polar_frames import frame_names, read_frame, read_grid, write_frame, write_grid
from jaxsim.discover import discover_folders, read_comparison
from jaxsim.effects import scan_of
from jaxsim.effects.chain import SensorModel
from jaxsim.frame import PolarImage

FEW = ("beam_gain", "range_falloff", "incidence_cosine", "random_dropout", "beam_range_bias", "extrinsic_rotation")


def simulate_anew(simulated: Path, out: Path, model: SensorModel) -> None:
    """The frames of a folder as a sensor with these effects reports them; their further rasters stay."""
    grid, about = read_grid(simulated)
    names = frame_names(simulated)
    images, more = zip(*(read_frame(simulated, name) for name in names), strict=True)
    reported = model.simulate(scan_of(grid, images, more, [about[name] for name in names]), jax.random.key(0))
    for k, name in enumerate(names):
        image = PolarImage(reported.range_m[k], reported.intensity[k], reported.valid[k])
        write_frame(out, name, image, **more[k])
    write_grid(out, grid, frames=about)


@pytest.fixture
def case(tmp_path: Path):
    """(key, folder) of beams with other gains."""
    sizes = {"scenes": 12, "rows": 24, "columns": 192, "nuisance": "exact"}
    return make_case(tmp_path / "case", effect="beam_gain", severity=6.0, seed=11, **sizes), tmp_path / "case"


def test_gains_are_in_the_files_and_lost_rays_become_rays_without_a_surface(case, standard_promotion):
    key, folder = case
    gain = key.effects[0]["parameters"]["gain"]
    model = SensorModel((("beam_gain", {"gain": tuple(gain)}), ("random_dropout", {"probability": 0.3})))
    simulate_anew(folder / "simulated", folder / "anew", model)
    before, after = (read_comparison(folder / side, folder / "measured").scan for side in ("simulated", "anew"))
    both = before.hit & after.hit & (before.intensity > 0) & (after.intensity > 0) & (after.intensity < 1)
    assert not (after.hit & ~before.hit).any()
    assert after.hit.sum() / before.hit.sum() == pytest.approx(0.7, abs=0.01)
    np.testing.assert_allclose(after.range_m[both], before.range_m[both], rtol=1e-6)
    ratio = np.log(np.where(both, after.intensity, 1) / np.where(both, before.intensity, 1))
    beams = [np.median(ratio[:, row][both[:, row]]) for row in range(24)]
    np.testing.assert_allclose(beams, gain, atol=1e-3)
    # What the surface is stays known of a ray that was lost.
    np.testing.assert_array_equal(after.semantic, before.semantic)


@pytest.mark.slow
def test_frames_simulated_anew_with_the_hidden_gains_lack_nothing(case, standard_promotion):
    key, folder = case
    model = SensorModel((("beam_gain", key.effects[0]["parameters"]),))
    simulate_anew(folder / "simulated", folder / "anew", model)
    result = discover_folders(simulated=folder / "anew", measured=folder / "measured", effects=FEW)
    assert json.loads(json.dumps(result.verdict.to_json()))["verdict"] == "none"
    assert result.sensor.effects == ()
