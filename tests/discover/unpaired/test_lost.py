"""Lost rays are told where row and azimuth suffice."""

import numpy as np
import pytest

from benchmarks.blind.hidden.streets import make_unpaired
from jaxsim.discover.scenes import difference_interval
from jaxsim.discover.unpaired.lost import _borders, _compared, _run, _sector, _Side, _single_rays, _sure_rows, lost_rays
from jaxsim.discover.unpaired.read import read_unpaired
from jaxsim.discover.unpaired.workflow import divide
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


@pytest.mark.parametrize("first", [0, 40, 112])
def test_columns_hidden_on_both_sides_of_the_seam_are_one_sector(first):
    columns = 120
    step = 2 * np.pi / columns
    azimuth = np.pi - (np.arange(columns) + 0.5) * step
    hidden = np.zeros(columns, bool)
    hidden[(first + np.arange(16)) % columns] = True
    zero = np.zeros(4, np.float32)
    around = PolarGrid(azimuth.astype(np.float32), zero, zero)
    told = _borders(around, _run(around, hidden))
    assert told["width_rad"].value == pytest.approx(16 * step, rel=1e-3)
    middle = np.pi - (first + 8) * step
    assert abs(np.angle(np.exp(1j * (told["azimuth_rad"].value - middle)))) < 1e-3
    ahead = PolarGrid((azimuth / 3).astype(np.float32), zero, zero)
    assert _borders(ahead, _run(ahead, hidden))["width_rad"].value <= 16 * step / 3 * 1.01


SIDE = (12, 6, 60)


def side(seed, *, lost=0.0, hidden=(), scenes=range(12)):
    """A frame a scene whose rays all had hit one surface: some are lost, and in some scenes columns are hidden."""
    rng = np.random.default_rng(seed)
    gone = rng.random(SIDE) < lost
    smooth = np.ones(SIDE, bool)
    for scene in scenes:
        gone[scene][:, list(hidden)] = True
    smooth[..., list(hidden)] = False
    return _Side(gone, smooth, np.arange(12))


def test_a_hidden_part_of_the_azimuth_does_not_make_losses_uneven():
    # The second of the six parts holds nothing that could be lost.
    hidden = np.isin(np.arange(60), range(10, 20))
    measured = side(0, lost=0.06, hidden=range(10, 20))
    named, notes = _single_rays(measured, side(1), np.ones(6, bool), columns=~hidden)
    assert [one.name for one in named] == ["random_dropout"]
    assert not notes
    # Frames in which nothing could be lost say nothing of the others.
    measured.smooth[:3] = False
    measured.lost[:3] = False
    (again,), _ = _single_rays(measured, side(1), np.ones(6, bool), columns=~hidden)
    assert again.gain.value == pytest.approx(0.06, abs=0.01)


def test_where_nothing_could_be_lost_no_share_is_compared():
    p, share = _compared(np.array([]), np.array([0.1, 0.2]))
    assert p == 1
    assert np.isnan(share.value)


@pytest.mark.parametrize(("scenes", "p"), [(12, 2.0**-12), (11, 13 * 2.0**-12), (8, None)])
def test_a_sector_is_as_sure_as_the_scenes_that_show_it_are_many(scenes, p):
    azimuth = np.linspace(0.7, -0.7, 60).astype(np.float32)
    hidden = np.isin(np.arange(60), range(20, 35))
    measured = side(0, hidden=range(20, 35), scenes=range(scenes))
    grid = PolarGrid(azimuth, np.zeros(6, np.float32), np.zeros(6, np.float32))
    named, notes = _sector(grid, hidden, measured=measured, simulated=side(1))
    if p is None:
        assert not named
        assert "15 columns without returns in 8 of 12 measured scenes" in notes[0]
        return
    assert named[0].p_value == pytest.approx(p)
    # It costs its columns in the scenes that show it alone.
    assert named[0].gain.value == pytest.approx(15 / 60 * scenes / 12)
    assert named[0].gain.low <= named[0].gain.value <= named[0].gain.high


def test_beside_a_real_sensor_rows_count_in_which_smooth_surfaces_lose_little():
    simulated = side(0)
    every = np.ones(60, bool)
    assert _sure_rows(simulated, every).all()
    # Half of the rays hit nothing, or what does not return: of the others none is lost.
    simulated.smooth[..., 1::2] = False
    simulated.lost[..., 1::2] = True
    assert _sure_rows(simulated, every).all()
    # In these rows smooth surfaces lose a tenth, and in the last there is none.
    simulated.lost[:, :2, ::10] = True
    simulated.smooth[:, 5] = False
    np.testing.assert_array_equal(_sure_rows(simulated, every), [False, False, True, True, True, False])
