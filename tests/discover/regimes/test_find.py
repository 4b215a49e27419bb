"""The whole method on drives of the independent generator: effects that act in a part are named, and placed."""

import json

import numpy as np
import pytest

from benchmarks.blind.hidden import make_case
from benchmarks.blind.regimes import cells, cells_of, f1
from jaxsim.discover import discover_folders
from jaxsim.discover.find.covariates import Dependence
from jaxsim.discover.name.answer import Answer
from jaxsim.discover.name.select import Choice
from jaxsim.discover.regimes import find as regimes
from jaxsim.discover.regimes.confine import Confined
from jaxsim.discover.verdict import Interval
from jaxsim.effects.chain import SensorModel
from jaxsim.report.discovery import write_report
from tests.discover.name.made import candidate, problem, step

pytestmark = [pytest.mark.long, pytest.mark.usefixtures("few_rays")]

SMALL = {"rows": 24, "columns": 192, "nuisance": "exact"}


def answered(folder, effect, part, seed, scenes, effects):
    key = make_case(folder, effect=effect, severity=10.0, seed=seed, part=part, scenes=scenes, **SMALL)
    result = discover_folders(simulated=folder / "simulated", measured=folder / "measured", effects=effects)
    return key, result, json.loads((folder / "measured" / "grid.json").read_text())


@pytest.fixture(scope="module")
def sector(tmp_path_factory, few_rays, standard_promotion):
    folder = tmp_path_factory.mktemp("sector") / "case"
    return answered(folder, "beam_range_bias", "sector", 21, 12, ("beam_range_bias",))


def test_an_effect_of_a_sector_is_named_there_with_parameters_of_its_full_size(sector):
    key, result, grid = sector
    [regime] = result.verdict.regimes
    assert (regime.effect, regime.divides) == ("beam_range_bias", "azimuth")
    assert f1(cells_of(regime.where.to_json(), grid), cells(key.part, grid)) > 0.85
    assert regime.outside.high < 0.2
    truth = np.array(key.effects[0]["parameters"]["bias_m"], float)
    found = np.array([one.value for one in result.verdict.effects[0].parameters["bias_m"]])
    seen = np.isfinite(truth)
    assert found[seen] @ truth[seen] / (truth[seen] @ truth[seen]) == pytest.approx(1, abs=0.15)


def test_its_sensor_model_acts_there_alone_and_its_report_says_so(sector, tmp_path):
    _, result, _ = sector
    result.effects_model.save(tmp_path / "sensor.json")
    assert SensorModel.load(tmp_path / "sensor.json").regions == {"beam_range_bias": result.verdict.regimes[0].where}
    page = write_report(tmp_path, result).read_text(encoding="utf-8")
    assert "beam_range_bias acts between" in page
    assert (tmp_path / "figures" / "regime_beam_range_bias.svg").is_file()


@pytest.mark.slow
def test_a_wave_round_the_sensor_is_no_effect_of_a_sector(tmp_path, standard_promotion):
    make_case(tmp_path / "case", effect="none", seed=24, scenes=16, **SMALL)
    for path in (tmp_path / "case" / "measured").glob("*.npz"):
        arrays = dict(np.load(path))
        azimuth = np.array(json.loads((path.parent / "grid.json").read_text())["azimuth"])
        wave_m = 0.06 * np.cos(azimuth + 0.7)
        arrays["range"] = np.where(arrays["range"] > 0, arrays["range"] + wave_m, 0).astype(np.float32)
        np.savez(path, **arrays)
    result = discover_folders(
        simulated=tmp_path / "case" / "simulated",
        measured=tmp_path / "case" / "measured",
        effects=("range_offset",),
    )
    assert (result.verdict.verdict, result.verdict.regimes) == ("not_in_catalogue", ())
    assert result.verdict.unexplained.covariate == "azimuth"


@pytest.mark.slow
def test_an_effect_that_half_of_the_scenes_have_is_named_from_its_moment_on(tmp_path, standard_promotion):
    key, result, grid = answered(tmp_path / "case", "beam_gain", "time", 22, 16, ("beam_gain", "range_falloff"))
    assert [one.name for one in result.verdict.effects] == ["beam_gain"]
    assert f1(cells_of(result.verdict.regimes[0].where.to_json(), grid), cells(key.part, grid)) > 0.85


@pytest.mark.slow
def test_an_effect_that_is_everywhere_has_no_regime(tmp_path, standard_promotion):
    _, result, _ = answered(tmp_path / "case", "beam_gain", "everywhere", 23, 12, ("beam_gain", "range_falloff"))
    assert [one.name for one in result.verdict.effects] == ["beam_gain"]
    assert result.verdict.regimes == ()


def test_an_effect_in_a_part_stands_beside_a_curve_of_another_channel():
    """Rain of some drives returns rays early; what it does to intensities is the curve's, and no reason to say none."""

    def stands(channel):
        confined = object.__new__(Confined)
        object.__setattr__(confined, "step", step(candidate("precipitation_clutter", 30, channel)))
        sized = regimes.Sized(confined, Interval.exact(1.0, ""), Interval.exact(0.0, ""), np.zeros(0))
        return regimes.stands_beside(found, sized)

    nothing = Choice((), (), problem())
    along = Dependence("intensity", "intensity", 0.01, 0.1, 50.0)
    found = Answer("not_in_catalogue", nothing, None, curve=(along, candidate("curve", 3)))
    assert stands("range")
    assert not stands("intensity")
    found = Answer("none", nothing, None)
    assert stands("intensity")
