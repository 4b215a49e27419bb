"""Lost rays are told where row and azimuth suffice."""

import numpy as np
import pytest

from benchmarks.blind.hidden.streets import make_unpaired
from jaxsim.discover.scenes import difference_interval
from jaxsim.discover.unpaired.lost import _bounded, _compared, _sector, lost_rays
from jaxsim.discover.unpaired.read import read_unpaired
from jaxsim.discover.unpaired.workflow import divide
from jaxsim.discover.verdict import Interval
from jaxsim.effects import EFFECTS
from jaxsim.frame import PolarGrid
from tests.discover.unpaired.made import SMALL


@pytest.mark.parametrize("effect", ["none", "random_dropout", "sector_occlusion", "window_contamination"])
def test_lost_rays_are_told_where_row_and_azimuth_suffice(tmp_path, standard_promotion, effect):
    folder = tmp_path / "case"
    key = make_unpaired(folder, effect=effect, severity=4.0, seed=13, **SMALL)
    comparison = read_unpaired(folder / "simulated", folder / "measured", per_scene=50)
    named, _ = lost_rays(comparison, divide(comparison)[1])
    if effect in ("random_dropout", "sector_occlusion"):
        assert [one.name for one in named] == [effect]
        assert (named[0].channels, named[0].gain.unit) == (("drop",), "share of rays")
        for name, truth in key.effects[0]["parameters"].items():
            assert named[0].parameters[name].low <= truth <= named[0].parameters[name].high
    else:
        assert not named


def test_the_interval_of_a_share_is_that_of_two_groups_of_scenes():
    rng = np.random.default_rng(0)
    measured = rng.normal(0.08, 0.01, 6)
    simulated = rng.normal(0.01, 0.002, 8)
    p, share = _compared(measured, simulated)
    assert p < 0.01
    assert (share.low, share.high) == difference_interval(measured, simulated)
    assert _compared(measured, measured)[0] > 0.3


def test_a_share_stays_within_the_bounds_of_a_probability():
    bounded = _bounded(Interval(0.1, -0.2, 2.0, "share of rays"), "packet_loss", "probability")
    p = EFFECTS["packet_loss"].parameters["probability"]
    assert (bounded.low, bounded.high) == (p.low, p.high)


@pytest.mark.parametrize("first", [0, 40, 112])
def test_columns_hidden_on_both_sides_of_the_seam_are_one_sector(first):
    columns = 120
    step = 2 * np.pi / columns
    azimuth = np.pi - (np.arange(columns) + 0.5) * step
    hidden = np.zeros(columns, bool)
    hidden[(first + np.arange(16)) % columns] = True
    zero = np.zeros(4, np.float32)
    told = _sector(PolarGrid(azimuth.astype(np.float32), zero, zero), hidden, scenes=8).parameters
    assert told["width_rad"].value == pytest.approx(16 * step, rel=1e-3)
    middle = np.pi - (first + 8) * step
    assert abs(np.angle(np.exp(1j * (told["azimuth_rad"].value - middle)))) < 1e-3
    ahead = PolarGrid((azimuth / 3).astype(np.float32), zero, zero)
    assert _sector(ahead, hidden, scenes=8).parameters["width_rad"].value <= 16 * step / 3 * 1.01
