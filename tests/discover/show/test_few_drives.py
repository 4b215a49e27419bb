"""What pieces of few drives show: effects bound to directions, of frames cast and disturbed in plain NumPy."""

from dataclasses import replace

import numpy as np
import pytest

from jaxsim.discover.find.division import Division, NullModel
from jaxsim.discover.model.cast import blocks
from jaxsim.discover.read import Comparison
from jaxsim.discover.rules import RULES
from jaxsim.discover.show.few_drives import ask_pieces, pieces_of, without_brightness
from jaxsim.effects import EFFECTS
from jaxsim.effects.chain import SensorModel
from jaxsim.effects.effect import CHANNELS
from tests.discover.noisy_street import COLUMNS, ROWS, comparison, grid

pytestmark = pytest.mark.usefixtures("standard_promotion")
ASKED = [EFFECTS[name] for name in ("sector_occlusion", "snr_dropout", "window_contamination")]
NOISE = {"share": 0.03, "range_m": 0.01}


def drive(lose=None, scenes: tuple[str, ...] = ("drive",)) -> Comparison:
    """Twelve frames, of a single drive if nothing else is said, of which the sensor loses what `lose` says of azimuth,
    elevation and simulated intensity."""
    one = comparison({}, NOISE, 12)
    at = grid()
    lost = np.zeros(one.measured.valid.shape, bool)
    if lose:
        lost |= lose(at.azimuth_rad[None, None, :], at.elevation_rad[None, :, None], np.asarray(one.scan.intensity))
    kept = {name: np.where(lost, 0, getattr(one.measured, name)) for name in ("range_m", "intensity")}
    measured = replace(one.measured, valid=one.measured.valid & ~lost, **kept)
    return replace(one, measured=measured, scenes=tuple(scenes[k % len(scenes)] for k in range(len(one.names))))


def asked(of: Comparison):
    return ask_pieces(NullModel.of(Division.of(of)), ASKED, log=lambda line: None)


def hidden(azimuth, elevation, intensity):
    """Nothing comes back from 0.4 rad about an azimuth of 1 rad, below an elevation of -0.05."""
    return (np.abs(azimuth - 1.0) < 0.2) & (elevation < -0.05) & (intensity >= 0)


def weak(azimuth, elevation, intensity):
    """Half of the echoes below an intensity are lost: far along the walls, so ahead and behind alone."""
    return (intensity < 0.05) & (np.random.default_rng(3).random(intensity.shape) < 0.5) & np.isfinite(azimuth)


@pytest.mark.long
@pytest.mark.usefixtures("few_rays_here")
# Of a single drive the mast below shows as much.
@pytest.mark.parametrize(
    ("scenes", "drives"),
    [pytest.param(("drive",), "1 drive", marks=pytest.mark.slow), (("a", "b", "c"), "3 drives")],
)
def test_a_hidden_sector_of_few_drives_is_found_and_known_to_what_comes_after(scenes, drives):
    found = asked(drive(hidden, scenes))
    [one] = found.effects
    assert (one.name, found.pieces) == ("sector_occlusion", RULES.sectors)
    assert f"found by {RULES.sectors} pieces of {drives}" in found.how
    # A fit looks at one column in twelve; borders are those of all columns, 0.013 rad apart.
    assert one.parameters["azimuth_rad"].value == pytest.approx(1.0, abs=0.01)
    assert one.parameters["width_rad"].value == pytest.approx(0.4, abs=0.02)
    assert [name for name, _ in found.known.effects] == ["sector_occlusion"]


@pytest.mark.long
@pytest.mark.usefixtures("few_rays_here")
def test_what_is_known_is_the_very_effect_whatever_was_found_before_it():
    one = drive(hidden, ("a", "b", "c"))
    rounded = replace(one, measured=replace(one.measured, range_m=np.round(one.measured.range_m / 0.1) * 0.1))
    found = ask_pieces(
        NullModel.of(Division.of(rounded)), [*ASKED, EFFECTS["range_quantization"]], log=lambda line: None
    )
    assert [effect.name for effect in found.effects] == ["sector_occlusion"]
    [(name, parameters)] = found.known.effects
    assert name == "sector_occlusion"
    assert parameters["azimuth_rad"] == pytest.approx(1.0, abs=0.01)


@pytest.mark.long
@pytest.mark.usefixtures("few_rays_here")
def test_a_mast_that_is_narrower_than_the_steps_between_columns_is_found_with_its_borders():
    """Three columns of 480: most frames look at none of them."""

    def mast(azimuth, elevation, intensity):
        return (np.abs(azimuth - 1.0) < 0.021) & (elevation < 9) & (intensity >= 0)

    found = asked(drive(mast))
    [one] = found.effects
    assert (one.name, found.pieces) == ("sector_occlusion", RULES.sectors)
    assert f"found by {RULES.sectors} pieces of 1 drive" in found.how
    assert [name for name, _ in found.known.effects] == ["sector_occlusion"]
    assert one.parameters["azimuth_rad"].value == pytest.approx(1.0, abs=0.01)
    assert one.parameters["width_rad"].value == pytest.approx(0.042, abs=0.02)


def test_pieces_are_of_consecutive_frames_of_a_drive_and_about_as_many_however_many_drives_there_are():
    assert pieces_of(["a"] * 24) == [f"piece {k // 2:02d}" for k in range(24)]
    assert pieces_of([*"ababab"] * 4) == [f"{name} piece {k // 2:02d}" for k in range(12) for name in "ab"]
    assert len(set(pieces_of([*"abc"]))) == 3


@pytest.mark.long
def test_what_goes_by_echoes_is_not_taken_for_a_direction():
    """Asked of all rays: in half of them no effect of a direction would stand in for it alone."""
    assert not asked(drive(weak)).effects


def test_several_drives_and_few_frames_have_no_pieces(monkeypatch):
    def never(*args, **more):
        pytest.fail("asked")

    monkeypatch.setattr("jaxsim.discover.show.few_drives.choose", never)
    monkeypatch.setattr(NullModel, "of", never)
    for scenes in ([f"drive {k}" for k in range(12)], ["drive"] * (RULES.fewest_scenes - 1)):
        # Of frames their drives and blocks alone are looked at: a fit of their own would take long.
        division, sectors = object.__new__(Division), object.__new__(NullModel)
        division.__dict__.update(blocks=blocks(scenes, ROWS, COLUMNS), scenes=tuple(scenes))
        sectors.__dict__.update(division=division, known=SensorModel())
        assert not ask_pieces(sectors, ASKED, log=lambda line: None).effects


def test_what_a_dark_wall_may_show_does_not_count():
    dark = np.zeros((8, len(CHANNELS)))
    dark[:, CHANNELS.index("intensity")] = 20.0
    assert not without_brightness(dark)
    dirty = dark.copy()
    dirty[:, CHANNELS.index("drop")] = 5.0
    assert without_brightness(dirty)
    # One piece alone decides nothing.
    once = dark.copy()
    once[0, CHANNELS.index("drop")] = 500.0
    assert not without_brightness(once)
