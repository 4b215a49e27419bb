"""The whole method on drives of the independent generator, small: it names what is hidden and nothing else."""

import inspect
import json
from pathlib import Path

import jax
import numpy as np
import pytest

from benchmarks.blind.hidden import make_case, score
from jaxsim.data.polar_frames import frame_names, read_frame, read_grid, write_frame, write_grid
from jaxsim.discover import (
    disagreements,
    discover,
    discover_folders,
    discover_unpaired,
    judge_known,
    read_comparison,
)
from jaxsim.effects import EFFECTS, scan_of
from jaxsim.effects.chain import SensorModel
from jaxsim.frame import PolarImage

pytestmark = [pytest.mark.long, pytest.mark.usefixtures("few_rays")]

FEW = ("beam_gain", "range_falloff", "incidence_cosine", "random_dropout", "beam_range_bias", "extrinsic_rotation")
"""Candidates of the small form; the slow one takes the whole catalogue."""
NULLS = 2
SMALL = {"scenes": 12, "rows": 24, "columns": 192, "nuisance": "exact"}


@pytest.fixture(scope="module")
def gains(tmp_path_factory, few_rays, standard_promotion):
    folder = tmp_path_factory.mktemp("hidden") / "case"
    key = make_case(folder, effect="beam_gain", severity=6.0, seed=11, **SMALL)
    both = {"simulated": folder / "simulated", "measured": folder / "measured"}
    return key, discover_folders(**both, effects=FEW, nulls=NULLS), folder


@pytest.fixture(scope="module")
def comparison(gains):
    """Its frames, as they are read."""
    return read_comparison(gains[2] / "simulated", gains[2] / "measured")


def test_a_hidden_beam_gain_is_named_first(gains):
    key, result, _ = gains
    scored = score(key, result.verdict.to_json())
    assert scored["verdict"] == "named"
    assert scored["first_right"]


def test_nulls_of_these_data_gain_less_than_what_is_hidden(gains):
    nulls = gains[1].verdict.nulls
    assert len(nulls.effects) == len(nulls.gains) == len(nulls.free) == NULLS
    assert max(nulls.gains) <= nulls.bar == gains[1].verdict.ranking[0].bar
    assert nulls.bar < gains[1].verdict.effects[0].gain.value / 10
    assert gains[1].verdict.to_json()["nulls"]["answered"] == nulls.answered


def test_the_rows_are_where_simulation_and_measurement_disagree(gains, comparison):
    where = disagreements(comparison)
    assert where == gains[1].verdict.where
    assert (where[0].channel, where[0].covariate) == ("intensity", "row")


def test_its_gains_are_those_that_were_hidden(gains):
    key, result, _ = gains
    truth = np.asarray(key.effects[0]["parameters"]["gain"])
    found = np.asarray(dict(result.effects_model.effects)["beam_gain"]["gain"])
    assert np.corrcoef(truth, found)[0, 1] > 0.9


def test_the_gap_shrinks_on_scenes_that_nothing_was_fitted_to(gains):
    _, result, _ = gains
    gap = result.verdict.gap["intensity"]
    assert gap.after < gap.before
    assert gap.low > 0
    assert not set(result.verdict.find) & set(result.verdict.judge)
    assert result.verdict.gap["range"].not_worse


def test_what_moved_lists_noise_gain_and_reflectances(gains):
    _, result, folder = gains
    with np.load(next((folder / "simulated").glob("*.npz"))) as frame:
        classes = {f"class {k}" for k in np.unique(frame["semantic"])}
    assert {"intensity", "drop", "gain"} | classes <= set(result.verdict.moved)
    before, after = result.verdict.moved["intensity"]
    assert after < before


def test_with_the_answer_fed_back_there_is_nothing_more(gains, comparison):
    first = gains[1]
    again = discover(comparison, effects=FEW, known=first.effects_model)
    assert again.verdict.verdict == "none"
    assert again.effects_model == first.effects_model
    assert any(note.startswith("beside what the sensor model already had: beam_gain,") for note in again.verdict.notes)
    before, after = first.verdict.gap["intensity"].after, again.verdict.gap["intensity"].before
    assert after == pytest.approx(before, rel=0.02)


def test_the_sensor_model_goes_through_its_file(gains, tmp_path):
    _, result, _ = gains
    result.effects_model.save(tmp_path / "sensor.json")
    assert SensorModel.load(tmp_path / "sensor.json", rows=24) == result.effects_model


def test_the_verdict_is_plain_json(gains):
    _, result, _ = gains
    content = json.loads(json.dumps(result.verdict.to_json()))
    assert content["verdict"] == "named"
    assert set(content["gap"]) == {"intensity", "range", "drop", "closure"}
    assert len(content["effects"][0]["parameters"]["gain"]["value"]) == 24


# The few are asked of the frames in which tests/discover/repeats/test_examine.py hides something that repeats.
@pytest.mark.parametrize(
    ("effects", "severity"),
    [(FEW, 1.0), pytest.param(tuple(EFFECTS), 2.0, marks=pytest.mark.slow)],
    ids=["few", "all"],
)
def test_where_nothing_is_hidden_nothing_is_named(tmp_path, standard_promotion, effects, severity):
    key = make_case(tmp_path / "case", effect="none", severity=severity, seed=12, **SMALL)
    result = discover_folders(
        simulated=tmp_path / "case" / "simulated", measured=tmp_path / "case" / "measured", effects=effects
    )
    verdict = result.verdict
    assert score(key, verdict.to_json())["right"]
    assert (verdict.repeats, verdict.learned, verdict.law) == ((), (), None)
    assert result.effects_model.effects == ()


def test_a_negative_number_of_nulls_is_refused(comparison):
    with pytest.raises(ValueError, match="nulls is -1; give how many to draw"):
        discover(comparison, nulls=-1)


def test_an_unknown_candidate_is_an_error_that_lists_the_known(comparison):
    with pytest.raises(ValueError, match=r"no effect named 'beam_gian'; did you mean beam_gain\?"):
        discover(comparison, effects=("beam_gian",))


def simulate_anew(simulated: Path, out: Path, model: SensorModel) -> None:
    """The frames of a folder as a sensor with these effects reports them; their further rasters stay."""
    grid, about = read_grid(simulated)
    names = frame_names(simulated)
    images, rasters = zip(*(read_frame(simulated, name) for name in names), strict=True)
    reported = model.simulate(scan_of(grid, images, rasters, about=[about[name] for name in names]), jax.random.key(0))
    for k, name in enumerate(names):
        image = PolarImage(reported.range_m[k], reported.intensity[k], reported.valid[k])
        write_frame(out, name, image, **rasters[k])
    write_grid(out, grid, frames=about)


def test_gains_are_in_the_files_and_lost_rays_become_rays_without_a_surface(gains, comparison, tmp_path):
    key, _, folder = gains
    gain = key.effects[0]["parameters"]["gain"]
    model = SensorModel((("beam_gain", {"gain": tuple(gain)}), ("random_dropout", {"probability": 0.3})))
    simulate_anew(folder / "simulated", tmp_path / "anew", model)
    before = comparison.scan
    after = read_comparison(tmp_path / "anew", folder / "measured").scan
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
def test_frames_simulated_anew_with_the_hidden_gains_lack_nothing(gains, tmp_path):
    key, _, folder = gains
    model = SensorModel((("beam_gain", key.effects[0]["parameters"]),))
    simulate_anew(folder / "simulated", tmp_path / "anew", model)
    result = discover_folders(simulated=tmp_path / "anew", measured=folder / "measured", effects=FEW)
    assert json.loads(json.dumps(result.verdict.to_json()))["verdict"] == "none"
    assert result.effects_model.effects == ()


@pytest.mark.parametrize("entry", [discover, discover_unpaired, disagreements, judge_known])
def test_every_entry_to_discovery_is_held_to_one_thread_and_keeps_its_signature(entry):
    assert entry.__wrapped__.__name__ == entry.__name__
    assert inspect.signature(entry).return_annotation is not inspect.Signature.empty
