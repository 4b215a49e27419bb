"""The world that Mitsuba renders: its light, its rays, and that a case hides what its key says and nothing else."""

import json

import numpy as np
import pytest

pytest.importorskip("mitsuba", reason="mitsuba is not installed (pip install -e '.[worlds]')")

from benchmarks.blind.hidden import score_case
from benchmarks.blind.mitsuba import make_case, materials, sensors
from benchmarks.blind.mitsuba.effects import EFFECTS, Plan, Setting
from benchmarks.blind.mitsuba.measure import measure
from benchmarks.blind.mitsuba.render import HEIGHT_M, look
from benchmarks.blind.mitsuba.roughness import rough_gain
from benchmarks.blind.mitsuba.street import ROAD, Street
from benchmarks.blind.mitsuba.streets import make_street
from jaxsim.discover import read_comparison

SMALL = {"scenes": 2, "rows": 16, "columns": 64}
OPTICS = sensors.SENSORS["turn"]
CHANCE = sensors.Chance(gain=1.0, speckle=0.02, photons=1e6, range_sd_m=0.01, lost=0.002)


@pytest.fixture(scope="module")
def view():
    azimuth, elevation = sensors.make_grid(OPTICS, 32, 128)
    return azimuth, look(make_street(np.random.default_rng(3), 1.0), azimuth, elevation, 0.0)


def test_a_road_of_lambert_returns_albedo_times_cosine_at_the_range_of_the_plane():
    street = Street(np.random.default_rng(0), 1.0)
    white = materials.lambert(materials.even(0.3))
    street.add(materials.mi.load_dict({"type": "rectangle", "to_world": materials._scaled((200, 200))}), ROAD, 0, white)
    elevation = np.deg2rad([-5.0, -10.0, -30.0])
    seen = look(street, np.linspace(1, -1, 8), elevation, 0.4)
    np.testing.assert_allclose(seen.range_m[:, 0], -HEIGHT_M / np.sin(elevation), rtol=1e-5)
    np.testing.assert_allclose(seen.true[:, 0], -0.3 * np.sin(elevation), rtol=1e-4)
    np.testing.assert_allclose(seen.incidence_rad[:, 0], np.pi / 2 + elevation, rtol=1e-4)


@pytest.mark.parametrize("strength", [0.4, 1.6])
def test_the_lobe_of_a_car_is_as_strong_head_on_as_asked(strength):
    paint = materials.lacquer(0.3, strength, 0.25)
    assert materials.head_on(paint.true) / materials.head_on(paint.plain) == pytest.approx(1 + strength, rel=0.05)


def test_a_rough_relief_is_as_bright_as_oren_and_nayar_say_up_to_70_degrees():
    theta, s = np.deg2rad([0.0, 30.0, 50.0, 60.0, 70.0]), 0.4
    a, b = 1 - 0.5 * s * s / (s * s + 0.33), 0.45 * s * s / (s * s + 0.09)
    expected = (a + b * np.sin(theta) * np.tan(theta)) / a
    np.testing.assert_allclose(rough_gain(s, np.random.default_rng(1))(theta), expected, rtol=0.12)


def test_same_seed_same_case_and_frames_that_discover_reads(tmp_path):
    for name in ("a", "b"):
        make_case(5, out=tmp_path / name, **SMALL)
    for file in sorted((tmp_path / "a").rglob("*.npz")):
        with np.load(file) as one, np.load(tmp_path / "b" / file.relative_to(tmp_path / "a")) as other:
            assert all(np.array_equal(one[key], other[key]) for key in one)
    comparison = read_comparison(tmp_path / "a" / "simulated", tmp_path / "a" / "measured")
    assert comparison.scenes == ("drive_000", "drive_001")


def test_a_null_with_an_ideal_simulator_differs_by_a_gain_and_noise_alone(tmp_path):
    truth = make_case(6, out=tmp_path / "null", **SMALL)
    assert truth.effects == []
    logs, apart = [], []
    for name in ("0000", "0001"):
        with (
            np.load(tmp_path / f"null/measured/{name}.npz") as m,
            np.load(tmp_path / f"null/simulated/{name}.npz") as s,
        ):
            both = (m["range"] > 0) & (s["range"] < 30) & (s["intensity"] > 0.02)
            logs.append(np.log(m["intensity"][both] / s["intensity"][both]))
            apart.append(m["range"][both] - s["range"][both])
    assert np.median(np.concatenate(logs)) == pytest.approx(np.log(truth.nuisance["gain"]), abs=0.01)
    assert np.concatenate(logs).std() < 0.08
    assert np.concatenate(apart).std() == pytest.approx(truth.nuisance["range_sd_m"], rel=0.1)


def _changes(view, plan: Plan) -> set[str]:
    azimuth, seen = view
    one, other = (
        measure(seen, seen.true, azimuth, p, CHANCE, OPTICS, np.random.default_rng(2)) for p in (Plan({}), plan)
    )
    both = (one["range"] > 0) & (other["range"] > 0)
    changed = {key for key in ("range", "intensity") if not np.array_equal(one[key][both], other[key][both])}
    return changed | ({"drop"} if ((one["range"] > 0) != (other["range"] > 0)).any() else set())


@pytest.mark.parametrize("name", [name for name, effect in EFFECTS.items() if effect.make])
def test_an_effect_acts_on_its_own_channels_alone(view, name):
    setting = Setting(np.random.default_rng(4), 32, np.pi, (7, 11, 26))
    effect = EFFECTS[name]
    assert _changes(view, effect.make(8 * effect.unit, setting)) == set(effect.channels)


@pytest.mark.parametrize("name", ["incidence_cosine", "oren_nayar", "specular_lobe"])
def test_effects_of_the_surface_leave_the_simulator_without_them(tmp_path, name):
    truth = make_case(7, effect=name, severity=8, out=tmp_path / name, **SMALL)
    make_case(7, out=tmp_path / "null", **SMALL)
    assert truth.effects[0]["right"][0] == name
    (tmp_path / name / "verdict.json").write_text('{"verdict": "none"}')
    assert not score_case(tmp_path / name, tmp_path / name / "verdict.json")["right"]
    at = "measured" if name == "oren_nayar" else "simulated"
    with np.load(tmp_path / f"null/{at}/0000.npz") as null, np.load(tmp_path / f"{name}/{at}/0000.npz") as planted:
        assert np.array_equal(null["range"], planted["range"])
        assert not np.allclose(null["intensity"], planted["intensity"], rtol=0.02)


def test_the_noisy_simulator_loses_one_ray_in_a_hundred_and_speaks_in_256_steps():
    even = np.full((200, 200), 20.0), np.full((200, 200), 0.2)
    told = sensors.simulate("noisy", OPTICS, *even, np.random.default_rng(0))
    assert (told["range"] == 0).mean() == pytest.approx(0.01, abs=0.003)
    assert np.allclose(told["intensity"] * 255, np.round(told["intensity"] * 255))
    assert told["range"][told["range"] > 0].std() == pytest.approx(0.015, rel=0.05)


def test_bare_cases_hold_range_and_intensity_and_their_scenes_alone(tmp_path):
    make_case(8, given="bare", simulator="noisy", sensor="coarse", out=tmp_path / "bare", **SMALL)
    with np.load(tmp_path / "bare/simulated/0000.npz") as frame:
        assert set(frame) == {"range", "intensity"}
    grid = json.loads((tmp_path / "bare/simulated/grid.json").read_text())
    assert grid["frames"]["0001"] == {"scene": "drive_001"}


def test_unknown_names_are_answered_with_the_known_ones_and_cases_are_not_overwritten(tmp_path):
    with pytest.raises(ValueError, match="choose one of none, incidence_cosine"):
        make_case(1, effect="fog", out=tmp_path / "x")
    with pytest.raises(ValueError, match="choose one of ideal, noisy"):
        make_case(1, simulator="carla", out=tmp_path / "x")
    (tmp_path / "x" / "measured").mkdir(parents=True)
    with pytest.raises(FileExistsError, match="never overwritten"):
        make_case(1, out=tmp_path / "x")
