"""Different streets on the two sides: what can be told is named, what cannot is not, and the answer says so."""

import json

import numpy as np
import pytest

from benchmarks.blind.hidden.streets import make_unpaired
from jaxsim.cli import discover as command
from jaxsim.cli import stop_on_error
from jaxsim.discover import discover_unpaired
from jaxsim.discover.unpaired.conditional import compare
from jaxsim.discover.unpaired.effect_columns import untold
from jaxsim.discover.unpaired.law import Block, equations, exchanged, hats, lowered, solve
from jaxsim.discover.unpaired.lost import lost_rays
from jaxsim.discover.unpaired.read import read_unpaired, roughness_m
from jaxsim.discover.unpaired.refine import JointFit, refine
from jaxsim.discover.unpaired.workflow import divide
from jaxsim.effects.chain import SensorModel

SMALL = {"scenes": 12, "rows": 24, "columns": 192}
RAYS = 1000


@pytest.fixture(scope="module")
def gains(tmp_path_factory, standard_promotion):
    folder = tmp_path_factory.mktemp("streets") / "case"
    key = make_unpaired(folder, effect="beam_gain", severity=4.0, seed=5, **SMALL)
    return key, folder, discover_unpaired(simulated=folder / "simulated", measured=folder / "measured", per_scene=RAYS)


def answer(tmp_path, **case):
    folder = tmp_path / "case"
    make_unpaired(folder, **case, **SMALL)
    return discover_unpaired(simulated=folder / "simulated", measured=folder / "measured", per_scene=RAYS)


def test_hidden_beam_gains_are_named_and_measured(gains):
    key, _, result = gains
    assert result.verdict.verdict == "named"
    assert result.verdict.effects[0].name == "beam_gain"
    truth = np.asarray(key.effects[0]["parameters"]["gain"])
    found = np.asarray(dict(result.sensor.effects)["beam_gain"]["gain"])
    seen = np.isfinite(found) & (found != 0)
    assert np.corrcoef(truth[seen], found[seen])[0, 1] > 0.7


def test_the_gap_shrinks_on_streets_that_nothing_was_fitted_to(gains):
    gap = gains[2].verdict.gap["intensity"]
    assert gap.after < gap.before
    assert gap.low > 0


def test_the_answer_says_that_streets_differ_and_what_cannot_be_told(gains):
    notes = " ".join(gains[2].verdict.notes)
    assert "different streets" in notes
    assert "motion_distortion" in notes
    assert "beam_gain" not in notes


def test_the_command_writes_a_report_that_says_so(gains, tmp_path, monkeypatch):
    _, folder, result = gains
    monkeypatch.setattr(command, "discover_unpaired", lambda *, simulated, measured, log: result)
    command.Discover(
        measured=folder / "measured", simulated=folder / "simulated", out=tmp_path / "out", unpaired=True
    )()
    assert "different streets" in (tmp_path / "out" / "report.html").read_text()
    verdict = json.loads((tmp_path / "out" / "verdict.json").read_text())
    assert set(verdict["gap"]) == {"intensity", "range", "drop", "closure"}
    assert verdict["gap"]["range"] is None
    assert SensorModel.load(tmp_path / "out" / "sensor.json", rows=SMALL["rows"]) == result.sensor


def test_a_hidden_falloff_is_named(tmp_path, standard_promotion):
    verdict = answer(tmp_path, effect="range_falloff", severity=8.0, seed=6).verdict
    assert verdict.effects
    first = verdict.effects[0]
    assert "range_falloff" in (first.name, *first.look_alikes)


@pytest.mark.parametrize("effect", ["none", "beam_range_bias"])
def test_nothing_is_named_where_nothing_can_be_told(tmp_path, standard_promotion, effect):
    verdict = answer(tmp_path, effect=effect, severity=4.0, seed=7).verdict
    assert verdict.verdict == "none"
    assert any("beam_range_bias" in note for note in verdict.notes)


@pytest.mark.parametrize("effect", ["none", "random_dropout", "sector_occlusion", "window_contamination"])
def test_lost_rays_are_told_where_row_and_azimuth_suffice(tmp_path, standard_promotion, effect):
    folder = tmp_path / "case"
    key = make_unpaired(folder, effect=effect, severity=4.0, seed=13, **SMALL)
    comparison = read_unpaired(folder / "simulated", folder / "measured", per_scene=50)
    found = lost_rays(comparison, divide(comparison)[1]).effects
    if effect in ("random_dropout", "sector_occlusion"):
        assert [one.name for one in found] == [effect]
        for name, truth in key.effects[0]["parameters"].items():
            assert found[0].parameters[name].low <= truth <= found[0].parameters[name].high
    else:
        assert not found


def test_every_effect_is_told_or_listed_as_untold():
    assert "extrinsic_rotation" in untold(classes=False)
    assert set(untold(classes=True)) < set(untold(classes=False))
    assert "gamma_response" in untold(classes=False)


def test_too_few_streets(tmp_path, standard_promotion):
    folder = tmp_path / "case"
    make_unpaired(folder, seed=1, **SMALL | {"scenes": 7})
    with pytest.raises(SystemExit) as stop, stop_on_error():
        command.Discover(
            measured=folder / "measured", simulated=folder / "simulated", out=tmp_path / "out", unpaired=True
        )()
    assert "7 simulated scenes; where the streets differ each side needs 8" in str(stop.value)


def test_frames_of_the_same_readings_are_an_error(gains):
    _, folder, _ = gains
    with pytest.raises(ValueError, match="the same readings"):
        read_unpaired(folder / "measured", folder / "measured")


def test_noise_of_ranges_is_read_off_planes():
    rng = np.random.default_rng(0)
    azimuth = np.linspace(-0.5, 0.5, 200)
    wall = np.broadcast_to(10 / np.cos(azimuth), (50, 200))
    noisy = wall + rng.normal(0, 0.02, wall.shape)
    assert roughness_m(noisy, np.ones(wall.shape, bool)) == pytest.approx(0.02, rel=0.05)
    assert roughness_m(wall, np.ones(wall.shape, bool)) < 1e-3


def model(n=600, scenes=6, seed=0):
    """A law, one column of the measured side, levels of patches: y with a side effect of 0.5."""
    rng = np.random.default_rng(seed)
    x, scene = rng.uniform(0, 1, n), np.arange(n) % scenes
    law, side = hats(x, 5).astype(float), rng.normal(0, 1, (n, 1))
    sensed, patch = np.arange(scenes) % 2 == 1, scene * 10 + rng.integers(0, 10, n)
    y = np.sin(3 * x) + 0.5 * side[:, 0] * sensed[scene] + rng.normal(0, 0.2, 60)[patch] + rng.normal(0, 0.1, n)
    return law, side, scene, sensed, patch, y


def test_equations_are_generalised_least_squares():
    law, side, scene, sensed, patch, y = model()
    own = np.ones((len(y), 1))
    eq = equations(law, side, own, np.array([0.3]), 0.2, y, scene, patch, scenes=6, variance=0.01)
    inner, right, _, _ = eq.pooled(np.ones(6), sensed.astype(float))
    found, _, _ = solve(inner, right, [Block(np.array([0]), np.array([1e-9]))])
    # The same with the covariance of all rays written out.
    cov = 0.01 * np.eye(len(y)) + 0.3**2 * (scene[:, None] == scene) + 0.2**2 * (patch[:, None] == patch)
    x = np.concatenate([law, side * sensed[scene][:, None]], axis=1)
    a = x.T @ np.linalg.solve(cov, x) + np.diag([1.0] * law.shape[1] + [1e-9])
    assert found[0] == pytest.approx(np.linalg.solve(a, x.T @ np.linalg.solve(cov, y))[-1], rel=1e-6)


@pytest.fixture(scope="module")
def dirty(tmp_path_factory, standard_promotion):
    """A dirty window, and the comparison's candidates of that name."""
    folder = tmp_path_factory.mktemp("dirty") / "case"
    key = make_unpaired(folder, effect="window_contamination", severity=8.0, seed=3, **SMALL)
    comparison = read_unpaired(folder / "simulated", folder / "measured", per_scene=RAYS)
    _, find = divide(comparison)
    draws = np.zeros((50, len(find)))
    draws[:, find] = exchanged(comparison.measured[find], 50)
    problem = compare(comparison, find, draws)
    return key, problem, [c for c in problem.terms if c.name == "window_contamination"]


def test_a_fit_ends_at_the_hidden_patch_and_leaves_open_what_intensities_do_not_tell(dirty):
    key, problem, starts = dirty
    truth = key.effects[0]["parameters"]
    near = min(
        starts, key=lambda c: abs(np.angle(np.exp(1j * (c.columns.start["azimuth_rad"] - truth["azimuth_rad"]))))
    )
    found = refine(problem, [near.columns])
    values, said = found.values[0], found.intervals[0]
    assert np.angle(np.exp(1j * (values["azimuth_rad"] - truth["azimuth_rad"]))) == pytest.approx(0, abs=0.2)
    assert values["loss"] == pytest.approx(truth["loss"], abs=0.25)
    assert said["loss"].low > 0
    assert (said["drop"].low, said["drop"].high) == (0.0, 1.0)


def test_no_step_of_a_fit_raises_the_loss(dirty):
    _, problem, starts = dirty
    for start in starts[::4]:
        joint = JointFit(problem, [start.columns])
        before = joint.loss(joint.linear())
        after = joint.loss(joint.fit())
        assert after <= before


def test_exchanged_scenes_lower_the_loss_less_than_the_true_ones():
    law, side, scene, sensed, patch, y = model()
    both = np.concatenate([np.ones((len(y), 1)), side], axis=1)
    eq = equations(law, both, np.ones((len(y), 1)), np.array([0.3]), 0.2, y, scene, patch, scenes=6, variance=0.01)
    near, block = (Block(np.array([k]), np.array([1e-3])) for k in (0, 1))
    drops = lowered(eq, np.ones(6), exchanged(sensed, 20), near, [block])[:, 0]
    assert drops[0] > 2 * np.median(drops)
