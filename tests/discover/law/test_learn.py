"""A wave that no effect describes becomes a law, is told by a formula, and brings unseen scenes nearer."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim.discover.add import Added, add_effects
from jaxsim.discover.find.covariates import CURVES, Dependence, heights_at, with_basis
from jaxsim.discover.find.dependences import find_dependences
from jaxsim.discover.find.division import NOTHING_YET, Division, NullModel
from jaxsim.discover.law.learn import Form, curve_form
from jaxsim.discover.law.search import closed_law
from jaxsim.discover.model.fit import fit_noise, in_place
from jaxsim.discover.model.null_model import refitted
from jaxsim.discover.name.candidates import rank_effects
from jaxsim.discover.name.unexplained import describe_curve, free_curves
from jaxsim.discover.read import Comparison
from jaxsim.discover.scenes import jackknife_sd
from jaxsim.discover.show import gap_with, law_gains
from jaxsim.effects.chain import SensorModel
from jaxsim.effects.learned import Learned
from jaxsim.metrics.intervals import jackknife_half_width, student_reach
from tests.discover.toy import toy

pytestmark = pytest.mark.long

FRAMES = 12
SIZE = 0.15


def wave(azimuth):
    return SIZE * np.sin(2 * azimuth + 0.5)


@pytest.fixture(scope="module")
def division(standard_promotion):
    scan, measured = toy(FRAMES)
    light = measured.intensity * np.exp(wave(np.asarray(scan.grid.azimuth_rad)))
    names = tuple(f"frame {k}" for k in range(FRAMES))
    measured = replace(measured, intensity=np.clip(light, 0, 1).astype(np.float32))
    return Division.of(Comparison(scan, measured, names, names))


@pytest.fixture(scope="module")
def model(division):
    return NullModel.of(division)


@pytest.fixture(scope="module")
def null(model):
    return model.problem


@pytest.fixture(scope="module")
def form(null):
    dependence = Dependence("intensity", "azimuth", 0.01, 0.1, 50.0)
    [curve] = rank_effects(with_basis(null, "azimuth"), [CURVES["intensity"]], null_fits=null.null_fits)
    return Form.of(null, dependence, curve)


@pytest.fixture(scope="module")
def added(null, form) -> Added:
    return add_effects(null, [], known=NOTHING_YET, form=form)


def test_the_law_is_what_was_hidden_within_its_band(added):
    law = added.learned.learned
    assert (law.channel, law.kind, law.covariates) == ("intensity", "periodic", ("azimuth",))
    off = np.array(law.values) - wave(np.array(law.knots[0]))
    # The overall gain is another's to say.
    off -= off.mean()
    assert np.abs(off).max() < 0.05
    assert np.mean(np.abs(off) < 3 * np.array(law.sd)) > 0.7
    assert added.effects_model == SensorModel(learned=(law,))


def test_unseen_scenes_gain_by_it_and_not_by_its_opposite(model, null, added):
    def gains(added):
        return law_gains(model, added, before=null, effects=[])

    assert gains(added)
    [law] = added.law_refits
    opposite = {name: -value for name, value in law.fit.z.items()}
    assert not gains(replace(added, law_refits=(replace(law, fit=replace(law.fit, z=opposite)),)))
    assert not gains(add_effects(null, [], known=NOTHING_YET))


def test_its_formula_is_a_sine_of_its_period(added):
    law = closed_law(added.learned)
    assert law
    assert law.parameters["period"].value == pytest.approx(np.pi, rel=0.03)
    assert law.parameters["size"].value == pytest.approx(SIZE, rel=0.2)
    assert law.covariates == ("azimuth",)


def test_unseen_scenes_gain_by_it_and_nothing_is_left_of_it_once_it_is_known(division, model, null, added):
    noise = refitted(in_place(null, added.chain)).noise
    shown = gap_with(model, added.chain, noise)
    gap = shown.gap["intensity"]
    assert gap.gained
    assert gap.gained.low > 0
    assert gap.after < gap.before
    again = find_dependences(division, added.effects_model)
    before = fit_noise(null).loss
    after = fit_noise(again.null_model.problem).loss
    assert after < before - 50
    assert not [one for one in again.where if one.covariate == "azimuth" and one.channel == "intensity"]


def test_the_law_that_is_fitted_is_the_one_that_is_saved(division, null, form, added):
    fitted = in_place(null, added.chain, simulated=True).ev.rays
    applied = added.effects_model.apply(null.ev.rays, division.scan)
    np.testing.assert_allclose(np.asarray(fitted.log_intensity), np.asarray(applied.log_intensity), atol=1e-5)
    assert form.law == form.law
    assert form.law != replace(form, basis=2 * form.basis).law


def test_a_law_of_few_values_has_its_parabolas_numbers_and_a_knot_a_value(null):
    dependence = Dependence("intensity", "speed", 0.01, 0.1, 50.0)
    [curve] = rank_effects(with_basis(null, "speed"), [CURVES["intensity"]], null_fits=null.null_fits)
    form = Form.of(null, dependence, curve)
    assert form.bare.kind == "curve"
    speeds = np.unique(np.asarray(null.ev.rays.speed_mps))
    np.testing.assert_allclose(form.bare.knots[0], speeds)
    assert form.basis.shape == (len(speeds), 3)


def test_classes_have_no_formula(added):
    table = Learned("intensity", "table", ("class",), ((7.0, 11.0),), (0.1, 0.2), (0.0, 0.0))
    assert closed_law(replace(added.learned, learned=table, without=added.learned.without[:, :2])) is None


def test_a_known_law_of_what_the_frames_do_not_hold_is_refused(division):
    law = Learned("intensity", "curve", ("rgb",), ((0.0, 1.0),), (0.1, 0.2), (0.0, 0.0))
    with pytest.raises(ValueError, match="learned along rgb needs the frames' rgb"):
        find_dependences(division, SensorModel(learned=(law,)))


def test_the_jackknife_knows_the_scatter_of_a_mean():
    each = np.random.default_rng(0).normal(0, 1, (12, 200))
    without = (each.sum(0) - each) / 11
    np.testing.assert_allclose(jackknife_sd(without), each.std(0, ddof=1) / np.sqrt(12))
    np.testing.assert_allclose(jackknife_sd(without) * student_reach(12), jackknife_half_width(without))


def test_a_drop_law_begins_where_its_curve_ended(null):
    law = Form(
        Learned("drop", "curve", ("azimuth",), ((-1.0, 1.0),), (0.0, 0.0), (0.0, 0.0)),
        np.eye(2, dtype=np.float32),
        np.array([0.1, 0.3]),
    ).law
    after = law.apply({"height": jnp.asarray([0.1, 0.3], jnp.float32)}, null.ev.rays)
    lost = 1 - np.exp(np.asarray(after.log_keep))[np.asarray(null.ev.rays.hit)]
    assert 0.1 - 1e-5 <= lost.min() <= lost.max() <= 0.3 + 1e-5


def test_a_pair_that_clearly_says_more_becomes_a_product(standard_promotion):
    scan, measured = toy(FRAMES)
    # Along the azimuth alone only the mean of the speeds shows.
    shape = np.sin(np.asarray(scan.grid.azimuth_rad)) * np.asarray(scan.speed_mps)[:, None, None]
    light = np.clip(measured.intensity * np.exp(0.03 * shape), 0, 1).astype(np.float32)
    names = tuple(f"frame {k}" for k in range(FRAMES))
    null = NullModel.of(Division.of(Comparison(scan, replace(measured, intensity=light), names, names))).problem
    dependence, pair = (Dependence("intensity", name, 0.01, 0.1, 50.0) for name in ("azimuth", "azimuth x speed"))
    [curve] = rank_effects(with_basis(null, "azimuth"), [CURVES["intensity"]], null_fits=null.null_fits)
    assert curve_form(null, dependence, curve).bare.kind == "periodic"
    form = curve_form(null, dependence, curve, crossed=[pair])
    assert (form.bare.kind, form.bare.covariates) == ("product", ("azimuth", "speed"))
    fitted = add_effects(null, [], known=NOTHING_YET, form=form).learned
    assert fitted
    law = fitted.learned
    truth = 0.03 * np.sin(law.knots[0])[:, None] * np.asarray(law.knots[1])
    assert np.corrcoef(np.ravel(truth), law.values)[0, 1] > 0.95


def test_a_product_of_range_and_incidence_is_asked_whatever_residuals_show(null):
    """What is told of it, and its law, are the curve that was fitted."""
    [(best, curve)] = [one for one in free_curves(null, ()) if one[0].covariate == "range x incidence"]
    assert best.channel == "intensity"
    told = describe_curve(null, best, curve)
    assert (told.covariate, told.x) == ("range x incidence", ())
    form = Form.of(null, best, curve)
    assert (form.bare.kind, form.bare.covariates) == ("product", ("range", "incidence"))
    # On its own rays it has the height that the law has.
    numbers = np.mean([np.asarray(values["height"]) for values in curve.fitted_values], axis=0)
    law = replace(form.bare, values=tuple(form.start.tolist()))
    hit = np.asarray(null.ev.rays.hit)
    np.testing.assert_allclose(
        heights_at(null, null, along=best, numbers=numbers),
        np.asarray(law.height(null.ev.rays))[hit],
        atol=1e-5,
    )


def test_a_pair_that_says_no_more_stays_a_curve(null):
    dependence, pair = (Dependence("intensity", name, 0.01, 0.1, 50.0) for name in ("azimuth", "azimuth x speed"))
    [curve] = rank_effects(with_basis(null, "azimuth"), [CURVES["intensity"]], null_fits=null.null_fits)
    assert curve_form(null, dependence, curve, crossed=[pair]).bare.kind == "periodic"


def test_a_black_level_of_every_second_row_is_told_and_added_as_such(standard_promotion):
    """A gain of these rows, or of each row, says less: what is added shows most on what is dark."""
    scan, measured = toy(FRAMES)
    odd = np.arange(measured.intensity.shape[1])[None, :, None] % 2 == 1
    light = np.clip(measured.intensity + np.where(odd, 0.05, 0.0), 0, 1).astype(np.float32)
    names = tuple(f"frame {k}" for k in range(FRAMES))
    dependences = find_dependences(Division.of(Comparison(scan, replace(measured, intensity=light), names, names)))
    null = dependences.null_model.problem
    curves = free_curves(null, [one for one in dependences.single if one.channel == "intensity"])
    best, curve = curves[0]
    assert (best.covariate, best.adds) == ("even rows", True)
    gains = [one.total for along, one in curves if not along.adds]
    assert curve.total > max(gains) + 10
    law = add_effects(null, [], known=NOTHING_YET, form=curve_form(null, best, curve)).learned.learned
    assert (law.kind, law.adds) == ("table", True)
    assert law.values[1] - law.values[0] == pytest.approx(0.05, abs=0.01)
    assert describe_curve(null, best, curve).formula.startswith("Δ I ≈ +0.0")
