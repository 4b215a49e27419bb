"""The sensor model: order, files, and what is drawn against what was expected."""

import dataclasses
import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim.effects import EFFECTS, STAGES, all_rays
from jaxsim.effects.chain import SensorModel, frame_of, sample
from jaxsim.effects.edits import clutter_range
from jaxsim.effects.region import Region
from tests.effects.streets import clutter_of_everything, grid_of, road_and_walls

KEY = jax.random.key(3)


@pytest.fixture(scope="module")
def many():
    """A frame of many equal rays that hit a wall at 20 m, but for the last columns, which hit nothing."""
    shape = (1, 100, 400)
    one = frame_of(clutter_of_everything(), 0)
    hit = np.ones(shape, bool)
    hit[..., 300:] = False
    grid = grid_of(2.0, 100, 400)
    filled = jax.tree.map(lambda leaf: jnp.zeros((*shape, *leaf.shape[3:]), leaf.dtype), dataclasses.replace(
        one, grid=None, time_s=None, speed_mps=None, heading_rad=None))  # fmt: skip
    scan = dataclasses.replace(
        filled, grid=jax.tree.map(jnp.asarray, grid), time_s=one.time_s, speed_mps=one.speed_mps,
        heading_rad=one.heading_rad, hit=jnp.asarray(hit), range_m=jnp.where(jnp.asarray(hit), 20.0, 0.0),
        intensity=jnp.where(jnp.asarray(hit), 0.3, 0.0), glare_rad=jnp.full(shape, jnp.pi),
    )  # fmt: skip
    return scan, jax.jit(all_rays)(scan)


def seen(rays):
    return np.asarray(rays.hit)


def test_effects_are_brought_into_physical_order():
    model = SensorModel((("range_scale", {"scale": 1e-3}), ("beam_gain", {"gain": 0.1}), ("extrinsic_rotation", {})))
    assert [name for name, _ in model.effects] == ["extrinsic_rotation", "beam_gain", "range_scale"]
    places = [STAGES.index(effect.stage) for effect in EFFECTS.values()]
    assert places == sorted(places)


def test_a_gain_before_a_threshold_costs_echoes_and_gamma_after_it_does_not():
    scan = clutter_of_everything()
    rays = all_rays(scan)
    threshold = ("snr_dropout", {"threshold": -5.0})
    plain, dark, flat = (
        SensorModel(chain).apply(rays, scan)
        for chain in (
            (threshold,),
            (threshold, ("beam_gain", {"gain": -0.5})),
            (("gamma_response", {"gamma": 0.5}), threshold),
        )
    )
    assert (dark.log_keep < plain.log_keep).all()
    np.testing.assert_array_equal(np.asarray(flat.log_keep), np.asarray(plain.log_keep))


def test_models_are_put_beside_one_another_and_taken_apart():
    gain, fall = ("beam_gain", {"gain": 0.1}), ("range_falloff", {"exponent": 0.4})
    both = SensorModel((gain,)).beside(SensorModel((("beam_gain", {"gain": 0.3}), fall)))
    # What the first has stands as it has it.
    assert both == SensorModel((fall, gain))
    assert both.names == tuple(name for name, _ in both.effects)
    assert both.without(SensorModel((gain,))) == SensorModel((fall,))
    assert both.without(SensorModel((("beam_gain", {"gain": 0.2}),))) == both


def test_effects_keep_their_regions_beside_others_and_apart_from_them():
    gain, fall = ("beam_gain", {"gain": 0.1}), ("range_falloff", {"exponent": 0.4})
    left = Region(azimuth_rad=(0.0, 1.0))
    in_part = SensorModel((gain,), regions={"beam_gain": left})
    both = SensorModel((fall,)).beside(in_part)
    assert both == SensorModel((fall, gain), regions={"beam_gain": left})
    # What acts in one part is not what acts everywhere.
    assert both.without(SensorModel((gain,))) == both
    assert both.without(in_part) == SensorModel((fall,))


def test_what_is_saved_is_loaded(tmp_path):
    gains = tuple(float(g) for g in np.linspace(-0.2, 0.2, 5))
    model = SensorModel((("beam_gain", {"gain": gains}), ("material_dropout", {"probability": (0.1,) * 34})))
    model.save(tmp_path / "sensor.json")
    assert SensorModel.load(tmp_path / "sensor.json", rows=5) == model
    assert json.loads((tmp_path / "sensor.json").read_text())["effects"][0]["parameters"]["gain"] == list(gains)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("nonsense", "is not"),
        ('{"effects": [{}]}', "is not"),
        ('{"effects": 3}', "is not"),
        ({"name": "beam_gain", "parameters": [0.1]}, "is not"),
        ({"name": "magic"}, r"no effect named 'magic'\. .* Known: extrinsic_rotation, "),
        ({"name": "beam_gian"}, r"no effect named 'beam_gian'; did you mean beam_gain\? "),
        ({"name": "beam_gain", "parameters": {"again": 1}}, "no parameter again; it has gain"),
        ({"name": "gamma_response", "parameters": {"gamma": 9}}, r"gamma is 9; it must lie in 0\.3\.\.2"),
        ({"name": "gamma_response", "parameters": {"gamma": float("nan")}}, "NaN is no number of JSON"),
        ({"name": "gamma_response", "parameters": {"gamma": "much"}}, "no number"),
        ({"name": "gamma_response", "parameters": {"gamma": [1, 1]}}, "it is one number"),
        ({"name": "beam_gain", "parameters": {"gain": [0, 0]}}, "the sensor has 5 beams: give 5 numbers"),
        ({"name": "material_dropout", "parameters": {"probability": [0, 0]}}, "give 34 numbers"),
        (
            '{"effects": [{"name": "random_dropout"}, {"name": "random_dropout"}]}',
            "lists random_dropout more than once",
        ),
    ],
)
def test_a_file_that_cannot_be_right_is_refused_with_what_would_be(tmp_path, content, message):
    text = content if isinstance(content, str) else json.dumps({"effects": [content]})
    (tmp_path / "sensor.json").write_text(text)
    with pytest.raises(ValueError, match=message):
        SensorModel.load(tmp_path / "sensor.json", rows=5)


def test_a_missing_file_says_who_writes_one(tmp_path):
    with pytest.raises(ValueError, match="jaxsim discover"):
        SensorModel.load(tmp_path / "sensor.json")


def test_without_effects_every_ray_that_hits_returns_as_simulated(many):
    scan, rays = many
    image = SensorModel().sample(KEY, rays)
    np.testing.assert_array_equal(np.asarray(image.valid), seen(rays))
    np.testing.assert_allclose(np.asarray(image.range_m), np.asarray(scan.range_m))
    np.testing.assert_allclose(np.asarray(image.intensity), np.asarray(scan.intensity), rtol=1e-6)


def test_the_share_that_is_lost_is_as_expected(many):
    scan, rays = many
    model = SensorModel((("random_dropout", {"probability": 0.2}), ("material_dropout", {"probability": 0.5})))
    valid = np.asarray(model.sample(KEY, model.apply(rays, scan)).valid)
    assert abs(valid[seen(rays)].mean() - 0.8 * 0.5) < 0.01


def test_packets_take_groups_of_whole_columns(many):
    scan, rays = many
    model = SensorModel((("packet_loss", {"probability": 0.3, "columns": 5}),))
    valid = np.asarray(model.sample(KEY, model.apply(rays, scan)).valid)[0, :, :300]
    assert (valid.all(0) | ~valid.any(0)).all()
    groups = valid[0].reshape(-1, 5)
    assert (groups.all(1) | ~groups.any(1)).all()
    assert 0.1 < 1 - groups[:, 0].mean() < 0.5


@pytest.mark.parametrize(("power", "scale", "start"), [(2.0, 2.0, 0.5), (-2.0, 20.0, 1.5), (0.0, 1e6, 0.5)])
def test_clutter_has_its_density(many, power, scale, start):
    _, rays = many
    shape = rays.range_m.shape
    rays = dataclasses.replace(rays, clutter_power=jnp.full(shape, power), clutter_scale_m=jnp.full(shape, scale),
                               clutter_from_m=jnp.full(shape, start))  # fmt: skip
    end = jnp.full(shape, 20.0)
    drawn = np.asarray(clutter_range(jax.random.uniform(KEY, shape), rays, end)).ravel()
    assert drawn.min() >= start * 0.999
    assert drawn.max() <= 20.001
    edges = np.array([start, 1.8, 2.5, 4, 6, 9, 13, 20])
    fine = np.linspace(start, 20, 20001)
    mass = np.concatenate([[0], np.cumsum(fine[1:] ** power * np.exp(-fine[1:] / scale))])
    expected = np.diff(np.interp(edges, fine, mass / mass[-1]))
    share = np.histogram(drawn, edges)[0] / drawn.size
    np.testing.assert_allclose(share, expected, atol=0.01)


def test_clutter_lies_in_front_of_the_surface_and_in_the_sky(many):
    scan, rays = many
    model = SensorModel(
        (("interference", {"probability": 0.25, "intensity": 0.1}), ("random_dropout", {"probability": 0.9}))
    )
    image = jax.tree.map(np.asarray, model.sample(KEY, model.apply(rays, scan)))
    hit = seen(rays)
    false = image.valid & np.isclose(image.intensity, 0.1)
    assert abs(false[hit].mean() - 0.25) < 0.01
    assert abs(false[~hit].mean() - 0.25) < 0.02
    assert image.range_m[false & hit].max() < 20
    assert image.range_m[false & ~hit].max() > 90
    # The surface's own echo is lost, false returns are not.
    assert abs(image.valid[hit].mean() - (0.25 + 0.75 * 0.1)) < 0.01


def test_mixed_readings_lie_evenly_between_the_surfaces(many):
    scan, rays = many
    rays = dataclasses.replace(rays, beside_m=rays.beside_m.at[..., 1].set(26.0))
    model = SensorModel((("mixed_pixels", {"probability": 0.4}),))
    image = jax.tree.map(np.asarray, model.sample(KEY, model.apply(rays, scan)))
    read = image.range_m[seen(rays)]
    mixed = read[read > 20]
    assert abs(mixed.size / read.size - 0.4) < 0.01
    np.testing.assert_allclose(np.histogram(mixed, np.linspace(20, 26, 7))[0] / mixed.size, 1 / 6, atol=0.01)


def test_glare_reads_the_target_s_range_also_in_the_sky(many):
    scan, rays = many
    rays = dataclasses.replace(
        rays, glare_rad=jnp.full_like(rays.range_m, 0.02), glare_m=jnp.full_like(rays.range_m, 7.0)
    )
    model = SensorModel((("blooming", {"probability": 0.5, "radius_rad": 0.02}),))
    image = jax.tree.map(np.asarray, model.sample(KEY, model.apply(rays, scan)))
    assert abs((image.range_m == 7).mean() - 0.5 * np.exp(-1)) < 0.01
    assert (image.range_m[~seen(rays)] == 7).any()


def test_noise_of_effects_and_sensor_add_up(many):
    _, rays = many
    rays = dataclasses.replace(rays, noise_m=jnp.full_like(rays.range_m, 0.03))
    image = jax.tree.map(np.asarray, sample(KEY, rays, noise_m=0.04, noise=0.1))
    assert abs(image.range_m[image.valid].std() - 0.05) < 0.001
    assert abs(np.log(image.intensity[image.valid]).std() - 0.1) < 0.002


def test_steps_and_ceiling(many):
    _, rays = many
    rays = dataclasses.replace(rays, range_step_m=jnp.float32(0.25), intensity_step=jnp.float32(0.05),
                               intensity_top=jnp.float32(0.32))  # fmt: skip
    image = jax.tree.map(np.asarray, sample(KEY, rays, noise_m=0.5, noise=0.3))
    assert np.allclose(image.range_m % 0.25, 0)
    assert image.intensity.max() <= 0.3 + 1e-6
    assert np.allclose(image.intensity / 0.05, np.round(image.intensity / 0.05), atol=1e-4)


def test_a_frame_depends_on_its_key_and_place_alone():
    scan = road_and_walls(frames=3, speed=[0.0, 5.0, 10.0], time=[1e9, 1e9 + 30, 1e9 + 60])
    model = SensorModel((("random_dropout", {"probability": 0.3}), ("emitter_drift", {"rate": 1.0})))
    first, again = model.simulate(scan, KEY), model.simulate(scan, KEY)
    np.testing.assert_array_equal(first.valid, again.valid)
    assert first.range_m.shape == scan.range_m.shape
    assert (first.valid[0] != first.valid[1]).any()
    both = first.valid[0] & first.valid[2]
    np.testing.assert_allclose(first.intensity[2][both] / first.intensity[0][both], np.exp(-1), rtol=1e-4)


def test_a_reading_of_nothing_stays_one(many):
    scan, _ = many
    dark = dataclasses.replace(scan, intensity=jnp.zeros_like(scan.intensity))
    for effects in ((), (("beam_gain", {"gain": -0.5}),)):
        image = SensorModel(effects).simulate(dark, KEY)
        assert np.asarray(image.valid).any()
        assert not np.asarray(image.intensity).any()


def test_rounding_does_not_lift_a_reading_above_the_ceiling(many):
    scan, _ = many
    bright = dataclasses.replace(scan, intensity=jnp.where(scan.range_m > 0, jnp.float32(0.8), 0.0))
    model = SensorModel((("saturation", {"ceiling": 0.5}), ("intensity_quantization", {"step": 0.09})))
    assert np.asarray(model.simulate(bright, KEY).intensity).max() <= 0.5
