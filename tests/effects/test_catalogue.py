"""Every effect: nothing at neutral, finite derivatives, only its own channels, and its formula in NumPy."""

import re
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim.effects import CHANNELS, COVARIATE_NAMES, EFFECTS, STAGES, all_rays, get_effect
from jaxsim.effects.chain import apply_law
from tests.effects.streets import clutter_of_everything, fields_of
from tests.quick import quick_jit

ROWS = 5
INTENSITY = ("log_intensity", "intensity_step", "intensity_top", "clutter_log_intensity")
RANGE = ("reading_m", "noise_m", "between", "between_m", "ghost", "ghost_m", "range_step_m",
         "clutter", "clutter_power", "clutter_scale_m", "clutter_from_m")  # fmt: skip
DROP = ("log_keep", "column_loss", "hit")
IDLE = {"ghost_m": "ghost", "between_m": "between", "clutter_power": "clutter", "clutter_scale_m": "clutter",
        "clutter_from_m": "clutter", "clutter_log_intensity": "clutter"}  # fmt: skip
"""What means nothing where a probability is 0."""
NAMES = list(EFFECTS)


LOW = 0.0
"""Elevation up to which a sector is hidden."""


@cache
def scene():
    scan = clutter_of_everything()
    return scan, all_rays(scan)


@cache
def run(name):
    """The effect on stacked parameters and its derivative, compiled together."""
    effect = EFFECTS[name]
    scan, rays = scene()

    def both(values):
        def total(values):
            after = apply_law(effect, values, rays, scan=scan)
            floats = (x for x in jax.tree.leaves(after) if x.dtype == jnp.float32)
            return sum(jnp.where(jnp.abs(x) < 1e9, x, 0.0).sum() for x in floats), after

        return jax.grad(total, has_aux=True)(values)

    return quick_jit(jax.vmap(both))


def settings(effect):
    """Neutral, every start, and all parameters at their bounds and at a visible size."""
    clearly = {}
    for name, p in effect.parameters.items():
        value = p.neutral + p.scale if p.neutral + p.scale <= p.high else p.neutral - p.scale
        clearly[name] = np.clip(value, p.low, p.high)
    bounds = [{n: getattr(p, end) for n, p in effect.parameters.items()} for end in ("low", "high")]
    return [{}, clearly, *bounds, *effect.starts]


@cache
def results(name):
    effect = EFFECTS[name]
    values = [effect.values(given, ROWS) for given in settings(effect)]
    slopes, after = run(name)(jax.tree.map(lambda *leaves: jnp.stack(leaves), *values))
    return jax.device_get(slopes), jax.device_get(after)


@pytest.mark.parametrize("name", NAMES)
def test_neutral_parameters_leave_rays_as_they_were(name):
    _, before = scene()
    _, after = results(name)
    for field, value in fields_of(before).items():
        now = np.asarray(getattr(after, field)[0])
        if field in IDLE:
            assert (np.asarray(getattr(after, IDLE[field])[0]) == 0).all()
            continue
        np.testing.assert_allclose(now, np.asarray(value), rtol=1e-6, atol=1e-6, err_msg=field)


@pytest.mark.parametrize("name", NAMES)
def test_values_and_derivatives_are_finite_everywhere(name):
    slopes, after = results(name)
    for key, slope in slopes.items():
        assert np.isfinite(slope).all(), key
    for field, value in fields_of(after).items():
        assert not np.isnan(np.asarray(value, float)).any(), field
    assert (after.log_keep <= 0).all()
    for field in ("column_loss", "between", "ghost", "clutter"):
        assert ((getattr(after, field) >= 0) & (getattr(after, field) <= 1)).all()


@pytest.mark.parametrize("name", NAMES)
def test_it_changes_its_channels_and_no_other(name):
    _, before = scene()
    _, after = results(name)
    effect = EFFECTS[name]
    changed = {
        f for f, v in fields_of(before).items() if (np.asarray(getattr(after, f)[1:]) != np.asarray(v)[None]).any()
    }
    channels = {c for c, fields in zip(CHANNELS, (INTENSITY, RANGE, DROP), strict=True) if changed & set(fields)}
    if effect.stage == "geometry":  # small shifts on a coarse grid meet no other cell
        assert {"range"} <= channels <= set(effect.channels)
    else:
        assert channels == set(effect.channels)
    which = {"frame", "row", "column", "azimuth_rad", "elevation_rad", "phase", "time_s", "speed_mps", "heading_rad"}
    assert not changed & which
    met = {"range_m", "hit", "semantic", "incidence_rad", "beside_m"}
    assert bool(changed & met) == (effect.stage == "geometry")


@pytest.mark.parametrize("name", NAMES)
def test_its_row_of_the_catalogue_is_whole(name):
    effect = EFFECTS[name]
    assert effect.name == name
    assert effect.stage in STAGES
    assert set(effect.channels) <= set(CHANNELS)
    assert set(effect.covariates) <= set(COVARIATE_NAMES)
    assert set(effect.look_alikes) <= set(EFFECTS) - {name}
    for key, p in effect.parameters.items():
        assert p.low <= p.neutral <= p.high, key
        assert p.scale > 0
    for start in effect.starts:
        effect.values(start, ROWS)
    for text in (effect.title, effect.formula, effect.signature, effect.source):
        assert text.strip()
        assert "\n" not in text


@pytest.mark.parametrize("name", NAMES)
def test_its_source_is_a_work_that_can_be_looked_up(name):
    for work in EFFECTS[name].source.split("; "):
        assert re.search(r"\b(1[789]|20)\d\d\b|user manual", work, re.IGNORECASE), work


CLASS = np.linspace(0, 0.5, 34)
ROW = np.linspace(-0.1, 0.1, ROWS)
LOSSES = np.linspace(0, 0.9, ROWS)
FOCAL = np.linspace(2, 20, ROWS)


def cos(ray):
    return np.maximum(np.cos(ray["incidence_rad"]), 0.02)


def tan(ray):
    return np.sin(ray["incidence_rad"]) / cos(ray)


def around(angle, width):
    angle = (angle + np.pi) % (2 * np.pi) - np.pi
    return np.exp(-0.5 * (angle / width) ** 2)


def keep(probability):
    return {"log_keep": np.log(1 - probability)}


def light(nats):
    return {"log_intensity": nats, "log_power": nats}


def oren_nayar(ray, s=0.5):
    a, b = 1 - 0.5 * s**2 / (s**2 + 0.33), 0.45 * s**2 / (s**2 + 0.09)
    return light(np.log(a + b * np.sin(ray["incidence_rad"]) * tan(ray)))


def vehicle_lobe(ray):
    vehicle = ray["semantic"] == 26
    return light(np.where(vehicle, np.log(1 + 3 * cos(ray) ** 20), 0)) | keep(
        np.where(vehicle, 0.6 * (1 - np.cos(ray["incidence_rad"])), 0)
    )


def sign(ray):
    gain = (1 - np.exp(-8)) * -np.log(cos(ray)) + 2 * np.exp(-((ray["incidence_rad"] / 0.7) ** 2))
    return light(np.where(ray["semantic"] == 20, gain, 0))


def window(ray):
    b = 0.5 * around(ray["azimuth_rad"] - 0.4, 0.2)
    return light(np.log(1 - b)) | keep(0.3 * b)


def focal(ray):
    more = 0.3 * 256 / 255 * abs((1 - FOCAL[ray["row"]] / 131) ** 2 - (1 - ray["range_m"] / 131) ** 2)
    return {"log_intensity": np.log(np.exp(ray["log_intensity"]) + more) - ray["log_intensity"]}


def at_edge(ray, share, across):
    apart = np.abs(np.minimum(ray["beside_m"], 1e6) - ray["range_m"][:, None])
    least = np.maximum(0.3, share * ray["range_m"])
    step = 1 / (1 + np.float64(least[:, None] / np.maximum(apart, 1e-3)) ** 20)
    return np.where(ray["hit"], np.maximum(step[:, :2].max(1), across * step[:, 2:].max(1)), 0)


def faint(ray):
    below = np.maximum(1 - np.exp(ray["log_intensity"]) / 0.4, 0)
    return {"log_keep": -np.log1p(np.exp(-(ray["log_power"] + 5) / 0.7)) + np.log(1 - 0.6 * below)}


def saturated(ray):
    i = np.exp(ray["log_intensity"])
    bent = np.minimum(i / (1 + (2 * i) ** 6) ** (1 / 6), 0.4)
    return {"intensity_top": -0.6, "log_intensity": np.log(bent / i)}


def hits(ray, error):
    return {"reading_m": np.where(ray["hit"], error, 0)}


# What is added to which field, ray by ray, straight from the catalogue's table.
ORACLES = {
    "incidence_cosine": ({"exponent": 0.5}, lambda r: light(0.5 * np.log(cos(r)))),
    "oren_nayar": ({"roughness_rad": 0.5}, oren_nayar),
    "specular_lobe": ({"strength": 3.0, "exponent": 20.0, "mirror_loss": 0.6}, vehicle_lobe),
    "retroreflection": ({"gain": 2.0}, sign),
    "range_falloff": ({"exponent": 0.7}, lambda r: {"log_intensity": -0.7 * np.log(r["range_m"] / 10)}),
    "atmospheric_extinction": ({"coefficient_per_m": 0.01}, lambda r: light(-0.02 * r["range_m"])),
    "near_range_overlap": ({"distance_m": 8.0, "depth": 0.7},
                           lambda r: light(np.log(1 - 0.7 * np.exp(-((r["range_m"] / 8) ** 2))))),
    "window_contamination": ({"loss": 0.5, "azimuth_rad": 0.4, "width_rad": 0.2, "drop": 0.3}, window),
    "blooming": ({"probability": 0.5, "radius_rad": 0.05},
                 lambda r: {"ghost": np.where(r["glare_rad"] < 3, 0.5 * np.exp(-((r["glare_rad"] / 0.05) ** 2)), 0)}),
    "fog_backscatter": ({"probability": 0.2}, lambda r: {"clutter": 0.2}),
    "precipitation_clutter": ({"probability": 0.2}, lambda r: {"clutter": 0.2}),
    "interference": ({"probability": 0.2}, lambda r: {"clutter": 0.2}),
    "focal_compensation": ({"slope": 0.3, "focal_m": FOCAL}, focal),
    "beam_gain": ({"gain": ROW}, lambda r: light(ROW[r["row"]])),
    "emitter_drift": ({"rate": 0.2}, lambda r: light(-0.2 * r["time_s"] / 60)),
    "gamma_response": ({"gamma": 0.7}, lambda r: {"log_intensity": -0.3 * r["log_intensity"]}),
    "intensity_offset": ({"offset": 0.03}, lambda r: {"log_intensity": np.log1p(0.03 / np.exp(r["log_intensity"]))}),
    "saturation": ({"ceiling": 0.4, "compression": 2.0, "sharpness": 3.0}, saturated),
    "intensity_quantization": ({"step": 0.01}, lambda r: {"intensity_step": 0.01}),
    "snr_dropout": ({"threshold": -5.0, "width": 0.7, "limit": 0.4, "zero_loss": 0.6}, faint),
    "random_dropout": ({"probability": 0.3}, lambda r: keep(0.3)),
    "material_dropout": ({"probability": CLASS}, lambda r: keep(CLASS[r["semantic"]])),
    "beam_dropout": ({"probability": LOSSES}, lambda r: keep(LOSSES[r["row"]])),
    "edge_dropout": ({"probability": 0.4, "share": 0.2, "across_rows": 0.3},
                     lambda r: keep(0.4 * at_edge(r, 0.2, 0.3))),
    "range_gate": ({"minimum_m": 10.0, "maximum_m": 50.0},
                   lambda r: {"log_keep": np.where((r["range_m"] < 9.8) | (r["range_m"] > 51), -30, 0)}),
    "sector_occlusion": ({"azimuth_rad": 0.3, "width_rad": 0.6, "below_rad": LOW},
                         lambda r: {"log_keep": np.where((abs(r["azimuth_rad"] - 0.3) < 0.28)
                                                         & (r["elevation_rad"] < LOW), -30, 0)}),
    "packet_loss": ({"probability": 0.2}, lambda r: {"column_loss": 0.2}),
    "ambient_light": ({"strength": 0.6, "heading_rad": 1.0, "width_rad": 0.4},
                      lambda r: keep(0.6 * around(r["azimuth_rad"] + r["heading_rad"] - 1.0, 0.4))),
    "range_noise": ({"sd_m": 0.02}, lambda r: {"noise_m": 0.02 / np.sqrt(np.exp(r["log_power"] + 2))}),
    "range_walk": ({"amplitude_m": 0.1, "intensity": 0.2},
                   lambda r: hits(r, 0.1 * np.exp(-np.exp(r["log_intensity"]) / 0.2))),
    "incidence_range_bias": ({"divergence_rad": 0.002}, lambda r: hits(r, 0.001 * r["range_m"] * tan(r))),
    "range_scale": ({"scale": 0.01}, lambda r: hits(r, 0.01 * r["range_m"])),
    "range_offset": ({"offset_m": 0.06}, lambda r: hits(r, 0.06)),
    "cyclic_range_error": ({"sine_m": 0.03, "cosine_m": -0.02, "cycles_per_m": 0.4},
                           lambda r: hits(r, 0.03 * np.sin(0.8 * np.pi * r["range_m"])
                                          - 0.02 * np.cos(0.8 * np.pi * r["range_m"]))),
    "beam_range_bias": ({"bias_m": ROW}, lambda r: hits(r, ROW[r["row"]])),
    "range_quantization": ({"step_m": 0.1}, lambda r: {"range_step_m": 0.1}),
}  # fmt: skip


@pytest.mark.parametrize("name", ORACLES)
def test_the_formula_is_that_of_the_table(name):
    given, oracle = ORACLES[name]
    _, rays = scene()
    effect = EFFECTS[name]
    after = quick_jit(effect.apply)(effect.values(given, ROWS), rays)
    hit = np.asarray(rays.hit)
    # Where the gate and the sector are soft they are neither open nor shut.
    sure = hit.copy()
    if name == "range_gate":
        r = np.asarray(rays.range_m)
        sure &= ~(((r > 9.8) & (r < 10)) | ((r > 50) & (r < 51)))
    if name == "sector_occlusion":
        away = np.abs(np.asarray(rays.azimuth_rad) - 0.3)
        up = np.asarray(rays.elevation_rad)
        sure &= ~((away > 0.28) & (away < 0.3)) & ~((up > LOW - 0.01) & (up < LOW))
    ray = {f: np.asarray(v)[sure] for f, v in fields_of(rays).items() if np.shape(v)[:3] == hit.shape}
    for field, expected in oracle(ray).items():
        change = np.asarray(getattr(after, field), float) - np.asarray(getattr(rays, field), float)
        change = change[sure] if change.ndim else change
        np.testing.assert_allclose(change, np.broadcast_to(expected, change.shape), rtol=2e-4, atol=2e-5, err_msg=field)


def test_a_receiver_that_charges_like_a_capacitor_is_a_saturation():
    """c (1 - exp(-I / c)) is near one of the catalogue's curves, of bounds as they are."""
    _, rays = scene()
    intensity = np.linspace(0.01, 1.0, rays.log_intensity.size).reshape(rays.log_intensity.shape)
    rays = rays.replace(log_intensity=jnp.asarray(np.log(intensity), jnp.float32))
    charged = np.log(0.3 * -np.expm1(-intensity / 0.3))
    effect = EFFECTS["saturation"]
    apply = quick_jit(effect.apply)

    def off(sharpness: float, compression: float) -> float:
        given = {"sharpness": sharpness, "compression": compression}
        error = np.asarray(apply(effect.values(given, ROWS), rays).log_intensity) - charged
        return float(np.abs(error - error.mean()).max())

    steps = np.linspace(1.5, 4.0, 26)
    sharpest = effect.parameters["sharpness"].low
    assert min(off(s, c) for s in np.linspace(sharpest, 1.0, 11) for c in steps) < 0.03
    assert min(off(s, c) for s in (1.0, 2.0) for c in steps) > 0.05


def test_mixed_readings_reach_to_the_nearer_of_the_farther_neighbours():
    _, rays = scene()
    beside = jnp.broadcast_to(jnp.array([30.0, 22.0, 5.0, 5.0]), (*rays.range_m.shape, 4))
    twenty = jnp.full_like(rays.range_m, 20.0)
    rays = rays.replace(range_m=twenty, reading_m=twenty + 0.1, beside_m=beside)
    effect = EFFECTS["mixed_pixels"]
    after = effect.apply(effect.values({"probability": 0.5}, ROWS), rays)
    hit = np.asarray(rays.hit)
    np.testing.assert_allclose(np.asarray(after.between), np.where(hit, 0.5, 0))
    np.testing.assert_allclose(np.asarray(after.between_m)[hit], 22.1, rtol=1e-6)
    # Of what is not known to lie between already, half does.
    known = effect.apply(effect.values({"probability": 0.5}, ROWS), after)
    np.testing.assert_allclose(np.asarray(known.between), np.where(hit, 0.75, 0))
    for sides in ([20.2, 19.0, 50.0, 50.0], [jnp.inf, 20.0, 0.0, 0.0]):
        none = rays.replace(beside_m=jnp.broadcast_to(jnp.array(sides), beside.shape))
        assert (np.asarray(effect.apply(effect.values({"probability": 0.5}, ROWS), none).between) == 0).all()


def test_of_uncertain_intensities_the_mean_share_is_lost():
    """Against draws of them."""
    _, rays = scene()
    rays = rays.replace(log_power_sd=jnp.full_like(rays.log_intensity, 0.5))
    effect = EFFECTS["snr_dropout"]
    after = effect.apply(effect.values({"limit": 0.3, "zero_loss": 0.8}, ROWS), rays)
    hit = np.asarray(rays.hit)
    light = np.asarray(rays.log_intensity)[hit]
    drawn = np.exp(light[:, None] + 0.5 * np.random.default_rng(0).normal(size=20_000))
    lost = 0.8 * np.maximum(1 - drawn / 0.3, 0).mean(1)
    assert lost.min() < 0.1 < 0.3 < lost.max()
    np.testing.assert_allclose(1 - np.exp(np.asarray(after.log_keep)[hit]), lost, atol=0.01)


def test_laws_that_turn_or_move_rays_say_that_surfaces_are_looked_up_again():
    assert [name for name, effect in EFFECTS.items() if effect.casts] == [
        name for name, effect in EFFECTS.items() if effect.stage == "geometry"
    ]


def test_an_unknown_name_is_answered_with_the_known_ones():
    with pytest.raises(ValueError, match="Known: extrinsic_rotation, extrinsic_translation"):
        get_effect("magic")


def test_the_likelier_of_two_clutters_gives_the_ranges():
    _, rays = scene()
    for first, second, scale in ((0.1, 0.3, 20.0), (0.3, 0.1, 2.0)):
        fog, rain = EFFECTS["fog_backscatter"], EFFECTS["precipitation_clutter"]
        after = fog.apply(fog.values({"probability": first}, ROWS), rays)
        after = rain.apply(rain.values({"probability": second}, ROWS), after)
        hit = np.asarray(rays.hit)
        np.testing.assert_allclose(np.asarray(after.clutter), np.where(hit, 0.37, 0), rtol=1e-5)
        assert (np.asarray(after.clutter_scale_m)[hit] == scale).all()
