"""Residuals depend on the covariates that they were made of, alone and in pairs, and noise on none."""

from types import SimpleNamespace

import numpy as np
import pytest

from jaxsim.discover.find.covariates import Dependence, curve_basis, spelled
from jaxsim.discover.find.dependences import Additive, interactions, localise, reported

SCENES, EACH = 8, 50
"""Of the additive model's residuals."""
SHAPE = (12, 24, 16)
"""Of the rays that have a pair."""


def rays(rng, shape):
    """Host rays of a shape (b, c, r); each block is a frame of its own."""
    return SimpleNamespace(
        range_m=rng.uniform(3, 60, shape),
        incidence_rad=rng.uniform(0, 1.4, shape),
        row=rng.integers(0, 16, shape),
        column=np.broadcast_to(np.arange(shape[1])[None, :, None], shape),
        azimuth_rad=rng.uniform(-3, 3, shape),
        elevation_rad=rng.uniform(-0.4, 0.1, shape),
        semantic=rng.choice([7, 11, 26], shape),
        log_power=rng.normal(-2, 1, shape),
        log_intensity=rng.normal(-2, 0.5, shape),
        beside_m=rng.uniform(3, 60, (*shape, 4)),
        time_s=np.broadcast_to(np.arange(shape[0])[:, None, None] * 10.0, shape),
        phase=rng.uniform(0, 1, shape),
        speed_mps=np.broadcast_to(np.arange(shape[0])[:, None, None] * 1.0, shape),
        heading_rad=np.broadcast_to(np.arange(shape[0])[:, None, None] * 0.6, shape),
        rgb=rng.uniform(0, 1, (*shape, 3)),
    )


def made(seed: int, height: float) -> tuple[Additive, np.ndarray]:
    rng = np.random.default_rng(seed)
    groups = np.eye(3, dtype=np.float32)[rng.integers(0, 3, SCENES * EACH)]
    z = groups @ np.array([height, 0, -height]) + rng.normal(0, 1, SCENES * EACH)
    return Additive(z, {"group": groups}, np.repeat(np.arange(SCENES), EACH), scenes=SCENES), z


def test_a_prediction_is_ridge_regression_on_the_other_folds():
    model, z = made(0, 1.0)
    held = np.isin(np.arange(len(z)), model.parts[1])
    assert set(model.scene[held]).isdisjoint(model.scene[~held])
    x = np.empty((len(z), 4))
    for part, rows in zip(model.parts, model.held_out, strict=True):
        x[part] = rows
    beta = np.linalg.solve(x[~held].T @ x[~held] + 4.0 * np.eye(4), x[~held].T @ z[~held])
    np.testing.assert_allclose(model.predicted(["group"])[held], x[held] @ beta, rtol=1e-4, atol=1e-5)


def test_every_scene_gains_by_what_is_there_and_pays_for_what_is_not():
    model, _ = made(1, 1.0)
    assert (model.by_scene(model.predicted([]), model.predicted(["group"])) > 0).all()
    empty = [made(seed, 0.0)[0] for seed in range(2, 22)]
    lost = [one.by_scene(one.predicted([]), one.predicted(["group"])).sum() for one in empty]
    assert np.mean(lost) < 0


def test_what_every_fourth_scene_has_gains_there():
    rng = np.random.default_rng(3)
    scene = np.repeat(np.arange(16), EACH)
    x = rng.normal(0, 1, (len(scene), 1)).astype(np.float32)
    z = rng.normal(0, 1, len(scene)) + 2 * x[:, 0] * (scene % 4 == 0)
    model = Additive(z, {"x": x}, scene, scenes=16)
    assert (model.by_scene(model.predicted([]), model.predicted(["x"]))[::4] > 0).all()


def two_slopes(own: np.ndarray, other: np.ndarray) -> Additive:
    """Residuals that depend on covariate a by the slopes `own` of scenes, and on b by those of `other`."""
    rng = np.random.default_rng(8)
    scene = np.repeat(np.arange(len(own)), EACH)
    a, b = rng.normal(0, 1, (2, len(scene), 1)).astype(np.float32)
    z = rng.normal(0, 1, len(scene)) + own[scene] * a[:, 0] + other[scene] * b[:, 0]
    return Additive(z, {"a": a, "b": b}, scene, scenes=len(own))


def chance(model: Additive, best: int) -> float:
    return model.chance_of_best([], ["a", "b"], before=model.predicted([]), best=best)


def test_what_all_scenes_agree_on_no_turned_signs_reach():
    model = two_slopes(np.full(11, 0.6), np.zeros(11))
    # All signs turned at once are what was measured, too.
    assert chance(model, 0) == pytest.approx(2 / 2**11)
    assert chance(model, 1) > 0.05


def test_a_covariate_on_which_one_scene_goes_wild_does_not_hide_one_on_which_all_agree():
    wild = np.zeros(11)
    wild[4] = 20.0
    model = two_slopes(np.full(11, 1.0), wild)
    assert chance(model, 0) < 0.01
    assert chance(model, 1) > 0.1


def test_residuals_that_are_no_numbers_show_nothing():
    model = two_slopes(np.full(11, 0.6), np.zeros(11))
    before = model.predicted([])
    before[0] = np.nan
    assert model.chance_of_best([], ["a", "b"], before=before, best=0) == 1


@pytest.mark.parametrize("name", ["range", "incidence", "row", "class", "height"])
def test_the_covariate_that_the_residuals_depend_on_comes_first(name):
    rng = np.random.default_rng(0)
    shape = (10, 12, 16)
    r = rays(rng, shape)
    value = {"range": np.log(r.range_m), "incidence": r.incidence_rad, "row": (r.row % 5), "class": (r.semantic == 26)}
    value["height"] = 0.2 * r.range_m * np.sin(r.elevation_rad)
    z = rng.normal(0, 1, shape) + 0.5 * np.asarray(value[name], float)
    dependences = localise(r, {"intensity": (z - z.mean(), np.ones(shape, bool))}, np.arange(10))
    assert dependences[0].covariate == name
    assert dependences[0].p_value < 0.05


@pytest.mark.parametrize(("headings", "name"), [(1, "heading"), (0, "azimuth")])
def test_frames_of_one_heading_have_no_dependence_on_it(headings, name):
    """It is their azimuth then, told from another zero: what begins straight ahead and grows over the turn."""
    rng = np.random.default_rng(0)
    r = rays(rng, (10, 12, 16))
    r.heading_rad = headings * r.heading_rad
    z = rng.normal(0, 1, r.row.shape) + np.mod(r.azimuth_rad + r.heading_rad, 2 * np.pi) / 3
    dependences = localise(r, {"range": (z - z.mean(), np.ones(z.shape, bool))}, np.arange(10))
    assert dependences[0].covariate == name
    assert ("heading" in {one.covariate for one in dependences}) == (headings > 0)


@pytest.mark.parametrize(("size", "found"), [(0.3, False), (1.0, True)])
def test_what_is_little_along_the_height_is_of_materials(size, found):
    rng = np.random.default_rng(4)
    r = rays(rng, (10, 12, 16))
    z = rng.normal(0, 1, r.range_m.shape) + size * (r.range_m * np.sin(r.elevation_rad) > -2)
    told = [one.covariate for one in localise(r, {"intensity": (z - z.mean(), np.ones(z.shape, bool))}, np.arange(10))]
    assert ("height" in told) is found


def test_on_level_ground_a_range_that_is_off_is_no_dependence_on_the_height():
    """Heights there differ by what simulated ranges are off."""
    rng = np.random.default_rng(3)
    r = rays(rng, (10, 12, 16))
    r.elevation_rad = rng.uniform(-0.4, -0.05, r.range_m.shape)
    off = rng.normal(0, 0.02, r.range_m.shape)
    r.range_m = 1.7 / np.sin(-r.elevation_rad) + off
    counts = np.ones(off.shape, bool)
    assert "height" not in [one.covariate for one in localise(r, {"range": (-off / 0.02, counts)}, np.arange(10))]
    tried = localise(r, {"intensity": (-off / 0.02, counts)}, np.arange(10))
    assert tried[0].covariate == "height"


def test_noise_alone_depends_on_nothing_more_often_than_the_level_says():
    found = 0
    for seed in range(40):
        rng = np.random.default_rng(100 + seed)
        shape = (10, 6, 12)
        z = {name: (rng.normal(0, 1, shape), np.ones(shape, bool)) for name in ("intensity", "range")}
        found += any(dependence.p_value <= 0.05 for dependence in localise(rays(rng, shape), z, np.arange(10), most=1))
    assert found <= 5


def test_what_a_stronger_covariate_explains_is_not_counted_again():
    rng = np.random.default_rng(5)
    shape = (12, 12, 16)
    r = rays(rng, shape)
    r.log_power = np.log(r.range_m) + rng.normal(0, 0.3, shape)
    z = 0.8 * (np.log(r.range_m) - 3) + rng.normal(0, 1, shape)
    dependences = {p.covariate: p for p in localise(r, {"intensity": (z, np.ones(shape, bool))}, np.arange(12))}
    assert dependences["range"].gain > 10 * (dependences["power"].gain if "power" in dependences else 0)


@pytest.mark.parametrize(
    "dependence", [("range", "row", 0.06, 50.0), ("range", "row", 0.01, 9.0), ("intensity", "class", 0.01, 50.0)]
)
def test_what_chance_explains_is_slight_or_is_a_nuisance_itself_is_not_reported(dependence):
    channel, covariate, p, gain = dependence
    sure = [Dependence("drop", "class", 0.01, 0.1, 11.0), Dependence("range", "row", 0.01, 0.1, 12.0)]
    assert reported([*sure, Dependence(channel, covariate, p, 0.1, gain)]) == sure[::-1]


def test_hat_functions_sum_to_one():
    basis = curve_basis(np.random.default_rng(6).normal(size=300), "range")
    np.testing.assert_allclose(basis.sum(1), 1, atol=1e-6)


def alone(r, z, **settings):
    return interactions(r, {"range": (z - z.mean(), np.ones(SHAPE, bool))}, np.arange(12), level=0.05, **settings)


@pytest.mark.parametrize(
    ("pair", "first", "second"),
    [
        ("range x incidence", lambda r: r.range_m > 31.5, lambda r: r.incidence_rad > 0.7),
        ("row x class", lambda r: r.row > 7, lambda r: r.semantic == 11),
    ],
)
def test_a_dependence_on_two_covariates_that_neither_shows_alone_is_found(pair, first, second):
    rng = np.random.default_rng(0)
    r = rays(rng, SHAPE)
    share = np.mean(second(r))
    z = rng.normal(0, 1, SHAPE) + 1.2 * np.where(first(r), 0.5, -0.5) * (second(r) - share)
    (dependence,) = alone(r, z)
    assert dependence.covariate == pair
    assert dependence.p_value < 0.01
    assert 0.01 < dependence.share < 0.2


def test_what_single_covariates_explain_makes_no_pair():
    rng = np.random.default_rng(1)
    r = rays(rng, SHAPE)
    z = rng.normal(0, 1, SHAPE) + 0.6 * np.log(r.range_m) + 0.6 * r.incidence_rad + 0.4 * (r.row % 5)
    assert alone(r, z) == []


def test_noise_alone_has_a_pair_about_as_often_as_the_level_says():
    found = 0
    for seed in range(12):
        rng = np.random.default_rng(100 + seed)
        found += bool(alone(rays(rng, SHAPE), rng.normal(0, 1, SHAPE)))
    assert found <= 3


def test_few_scenes_decide_nothing():
    rng = np.random.default_rng(2)
    r = rays(rng, SHAPE)
    z = rng.normal(0, 1, SHAPE) + 3.0 * ((r.range_m > 31.5) == (r.incidence_rad > 0.7))
    scene = np.repeat(np.arange(4), 3)
    assert interactions(r, {"range": (z, np.ones(SHAPE, bool))}, scene, level=0.5) == []


def test_a_handful_of_events_tells_nothing():
    rng = np.random.default_rng(3)
    r = rays(rng, SHAPE)
    together = (r.range_m > 58) & (r.incidence_rad > 1.3)
    assert 5 < together.sum() < 60
    z = np.where(together, 30.0, -0.05)
    assert interactions(r, {"drop": (z, np.ones(SHAPE, bool))}, np.arange(12), level=1.0) == []


def test_a_pair_is_spelled_by_the_words_of_its_parts():
    assert spelled("range x step side") == "range x step"
    assert spelled("speed x time") == "time"
    assert spelled("row") == "row"


def test_frames_in_which_hardly_anything_varies_have_no_pair():
    rng = np.random.default_rng(4)
    r = rays(rng, SHAPE)
    flat = {name: np.full_like(value, value.flat[0]) for name, value in vars(r).items()}
    assert alone(type(r)(**(flat | {"semantic": r.semantic})), rng.normal(0, 1, SHAPE)) == []
