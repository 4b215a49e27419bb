"""Scans on a grid: every firing in a cell of its own, rows top first, one return a firing."""

import re

import numpy as np
import pytest

from jaxsim.data.logs import LogOptions
from jaxsim.data.logs.gridding import infer_layout, to_sweep
from jaxsim.data.logs.scan import scan_of_fields
from jaxsim.geometry import preset
from tests.data.logs.conftest import ELEVATION, FIRINGS, RINGS, expected, room

ASKED = LogOptions()


def scan(fields, options=ASKED, **more):
    return scan_of_fields(fields, options, by="test", where="here", name="000000", scene="room", **more)


def swept(fields, options=ASKED, **more):
    given = scan(fields, options, **more)
    return to_sweep(given, infer_layout([given], options, by="test"), options, by="test")


def test_every_firing_has_a_cell_of_its_own(fields):
    sweep = swept(fields)
    range_m, intensity = expected(fields)
    assert sweep.image.valid.all()
    np.testing.assert_allclose(sweep.image.range_m, range_m, rtol=1e-5)
    np.testing.assert_allclose(sweep.image.intensity, intensity, rtol=1e-6)
    np.testing.assert_allclose(sweep.grid.elevation_rad, ELEVATION, atol=1e-6)
    np.testing.assert_allclose(sweep.rasters["time"][-1], np.arange(FIRINGS) * 5e-4, atol=1e-7)


@pytest.mark.parametrize("turned", [0.0, 0.49, 0.5, 0.51, 0.99])
def test_firings_near_the_edge_of_columns_do_not_share_them(turned):
    """Each firing jitters by a tenth of a column about the edges, and the turn is not a whole number of firings."""
    rng = np.random.default_rng(1)
    fields = room(turned=turned)
    azimuth = np.arctan2(fields["y"], fields["x"]).astype(float)
    firing = np.repeat(np.arange(FIRINGS), RINGS)
    moved = azimuth - 2 * np.pi / FIRINGS * (rng.uniform(-0.1, 0.1, len(azimuth)) - 0.002 * firing)
    level = np.hypot(fields["x"], fields["y"])
    fields |= {"x": (level * np.cos(moved)).astype("f4"), "y": (level * np.sin(moved)).astype("f4")}
    sweep = swept(fields)
    # A ring slips once or twice in a turn; rounding by itself loses up to a sixth of the firings here.
    assert sweep.image.valid.sum() >= 0.985 * len(azimuth)


def test_rings_in_any_order_become_rows_top_first(fields):
    order = np.random.default_rng(2).permutation(RINGS)
    sweep = swept(fields | {"ring": order[fields["ring"]].astype("u2")})
    np.testing.assert_allclose(sweep.image.range_m, expected(fields)[0], rtol=1e-5)


def test_rings_may_count_from_one_and_later_scans_are_counted_alike(fields):
    fields["ring"] += 1
    first = scan(fields)
    layout = infer_layout([first] * 2, ASKED, by="test")
    np.testing.assert_allclose(layout.grid.elevation_rad, ELEVATION, atol=1e-6)
    np.testing.assert_array_equal(layout.beams.ring, np.arange(RINGS)[::-1] + 1)
    seen = fields["ring"] > 3  # the lowest ring of a later scan says nothing
    later = to_sweep(first.only(seen), layout, ASKED, by="test")
    np.testing.assert_array_equal(later.image.valid.all(axis=1), np.arange(RINGS) < RINGS - 3)


def test_a_first_ring_that_saw_nothing_keeps_its_row_where_the_log_tells_of_it(fields):
    """By the number of the beams, or by rays of it that did not come back."""
    seen = fields["ring"] > 0
    lines = LogOptions(lines=RINGS)
    given = scan({key: value[seen] for key, value in fields.items()})
    assert len(infer_layout([given], ASKED, by="test").beams.ring) == RINGS - 1
    assert len(infer_layout([given], lines, by="test").beams.ring) == RINGS
    lost = scan(fields | {"x": np.where(seen, fields["x"], np.nan)})
    assert len(infer_layout([lost], ASKED, by="test").beams.ring) == RINGS


def test_a_ring_that_saw_nothing_keeps_its_row(fields):
    seen = fields["ring"] != 5
    sweep = swept({key: value[seen] for key, value in fields.items()})
    assert sweep.image.range_m.shape[0] == RINGS
    assert not sweep.image.valid[RINGS - 1 - 5].any()
    np.testing.assert_allclose(sweep.grid.elevation_rad, ELEVATION, atol=1e-3)


def test_without_rings_the_elevations_tell_the_rows(fields):
    del fields["ring"]
    np.testing.assert_allclose(swept(fields).image.range_m, expected(fields)[0], rtol=1e-5)


@pytest.mark.parametrize("axis", [0, 1])
def test_organised_clouds_have_their_rings_along_an_axis(fields, axis):
    del fields["ring"]
    tables = {key: value.reshape(FIRINGS, RINGS) for key, value in fields.items()}
    tables = {key: value.T if axis == 0 else value for key, value in tables.items()}
    shape = tables["x"].shape
    jittered = tables["z"] + np.random.default_rng(0).normal(0, 0.02, shape)  # elevations alone no longer tell
    sweep = swept({**tables, "z": jittered.astype("f4")}, shape=shape)
    assert sweep.image.valid.all()
    np.testing.assert_allclose(sweep.image.intensity, expected(fields)[1], rtol=1e-6)


def on_beams_of(fields, name):
    """The room as the upper beams of a known sensor see it, each from its own origin; rings count from below."""
    spec = preset(name)
    elevation, origin = spec.elevation_rad[:RINGS][::-1], np.asarray(spec.origin_m)[:RINGS][::-1]
    level = np.hypot(fields["x"], fields["y"]).reshape(FIRINGS, RINGS)
    return fields | {"z": (origin + level * np.tan(elevation)).astype("f4").ravel()}


def test_points_of_a_named_sensor_lie_on_the_beam_that_passes_nearest_from_its_own_origin(fields):
    """Seen from the origin of the points, those of an HDL-64E lie three lines off their own at ten metres."""
    options = LogOptions(sensor="hdl64e")
    del fields["ring"]
    given = scan(on_beams_of(fields, "hdl64e"), options)
    layout = infer_layout([given], options, by="test")
    assert layout.beams.off_deg < 1e-3
    image = to_sweep(given, layout, options, by="test").image
    assert not image.valid[RINGS:].any()
    assert image.valid[:RINGS].all()
    np.testing.assert_allclose(image.intensity[:RINGS], expected(fields)[1], rtol=1e-6)


@pytest.mark.parametrize("axis", [0, 1])
def test_of_a_named_sensor_the_beam_is_not_the_place_in_the_array(fields, axis):
    del fields["ring"]
    tables = {key: value.reshape(FIRINGS, RINGS) for key, value in on_beams_of(fields, "vlp16").items()}
    tables = {key: value.T if axis == 0 else value for key, value in tables.items()}
    sweep = swept(tables, LogOptions(sensor="vlp16"), shape=tables["x"].shape)
    np.testing.assert_allclose(sweep.image.intensity, expected(fields)[1], rtol=1e-6)


def test_clouds_without_rings_or_lines_are_refused(fields):
    del fields["ring"]
    fields["z"] = fields["z"] + np.random.default_rng(0).normal(0, 0.5, len(fields["z"])).astype("f4")
    with pytest.raises(
        ValueError,
        match=r"test: the sensor's beams cannot be told from 000000: .*have no ring.*--log.mount fit.*"
        r"its points have x, y, z, intensity, t, and the ring's name would be ring, laser_number",
    ):
        swept(fields)


def test_a_cloud_in_the_cars_frame_is_refused_and_its_mounting_can_be_fitted(fields):
    fields |= {"x": fields["x"] + np.float32(1.4), "z": fields["z"] + np.float32(1.8)}
    with pytest.raises(ValueError, match="not in the sensor's own frame"):
        swept(fields)
    options = LogOptions(mount="fit")
    given = scan(fields, options)
    layout = infer_layout([given], options, by="test")
    np.testing.assert_allclose(layout.cloud_from_sensor[:3, 3], (1.4, 0, 1.8), atol=2e-3)
    sweep = to_sweep(given, layout, options, by="test")
    assert sweep.image.valid.mean() > 0.99


def test_of_two_returns_the_strongest_or_the_last_is_kept(fields):
    half = {key: value.copy() for key, value in fields.items()}
    for axis in "xyz":
        half[axis] *= np.float32(0.5)
    half["intensity"][:] = 1  # nearer and weaker
    both = {key: np.concatenate([half[key], fields[key]]) for key in fields}
    for returns in ("strongest", "last"):
        sweep = swept(both, LogOptions(returns=returns))
        np.testing.assert_allclose(sweep.image.range_m, expected(fields)[0], rtol=1e-5)
    half["intensity"][:] = 255
    fields["intensity"] = np.minimum(fields["intensity"], 254)
    both = {key: np.concatenate([half[key], fields[key]]) for key in fields}
    np.testing.assert_allclose(swept(both).image.range_m, expected(fields)[0] / 2, rtol=1e-5)
    last = swept(both, LogOptions(returns="last"))
    np.testing.assert_allclose(last.image.range_m, expected(fields)[0], rtol=1e-5)


def test_a_sensor_that_looks_ahead_gets_a_window(fields):
    ahead = np.abs(np.arctan2(fields["y"], fields["x"])) < np.deg2rad(40)
    sweep = swept({key: value[ahead] for key, value in fields.items()})
    assert sweep.image.range_m.shape[1] == pytest.approx(40, abs=1)
    assert sweep.image.valid.mean() > 0.97
    assert np.rad2deg(sweep.grid.azimuth_rad[[0, -1]]) == pytest.approx((39, -39), abs=1.5)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"intensity": np.full(RINGS * FIRINGS, 300.0, "f4")}, "does not say what is full scale"),
        ({"intensity": np.full(RINGS * FIRINGS, -1.0, "f4")}, r"intensity spans -1\.\.-1, off the log's scale"),
        (
            {"t": np.linspace(0, 1e5, RINGS * FIRINGS)},
            r"times of its points span 100000 s, and a turn takes at most 10",
        ),
        (
            {"t": np.linspace(0, 1e5, RINGS * FIRINGS).astype("u4")},
            r"span 0\.0001 s, and a turn takes at least 0\.005: .*\(whole microseconds look so\); write them so",
        ),
        ({"t": np.linspace(0, 100, RINGS * FIRINGS).astype("u4")}, r"\(whole milliseconds look so\); write them so"),
        ({"x": room()["x"] * 1000, "ring": np.arange(RINGS * FIRINGS) % 7}, "must be in metres .divide millimetres"),
        ({"ring": np.full(RINGS * FIRINGS, 0.5)}, "rings that are no whole numbers"),
        ({"ring": np.zeros(RINGS * FIRINGS, "u2")}, "two are needed to tell a sensor"),
        ({"ring": np.arange(RINGS * FIRINGS) % 7}, "the rings are not its beams"),
        ({"ring": np.arange(RINGS * FIRINGS)}, "no sensor has more than 1024 beams"),
        ({"ring": np.where(np.arange(RINGS * FIRINGS), np.arange(RINGS * FIRINGS) % RINGS, 130)}, "beyond the zenith"),
    ],
)
def test_values_that_cannot_be_are_named(fields, change, message):
    with pytest.raises(ValueError, match=message):
        swept(fields | change)


def test_a_part_of_a_turn_may_be_short_and_one_time_for_all_points_is_the_scans(fields):
    layout = infer_layout([scan(fields)], ASKED, by="test")
    part = scan(fields).only(np.arange(RINGS * FIRINGS) < RINGS * 5)
    assert 0 < np.ptp(part.offset_s) < 5e-3
    to_sweep(part, layout, ASKED, by="test")
    to_sweep(scan(fields | {"t": np.full(RINGS * FIRINGS, 7, "u4")}), layout, ASKED, by="test")


@pytest.mark.parametrize(
    ("largest", "kind", "told"),
    [
        (255, "u2", "reaches 255 in the first scans, and 65535 is taken for full scale: .*--log.full-scale 255, with"),
        (1, "u1", "reaches 1 in the first scans, and 255 is taken for full scale: .*--log.full-scale 1, with"),
        (300, "u2", "--log.full-scale and the sensor's own, with"),
        (400, "u2", ""),
        (0, "u2", ""),
    ],
)
def test_intensities_far_under_full_scale_are_told(fields, caplog, largest, kind, told):
    dark = scan(fields | {"intensity": np.linspace(0, largest, RINGS * FIRINGS).astype(kind)})
    infer_layout([dark], ASKED, by="test")
    assert re.search(told, caplog.text) if told else not caplog.text
    caplog.clear()
    infer_layout([dark], LogOptions(full_scale=255), by="test")
    assert not caplog.text


def test_missing_fields_are_named(fields):
    del fields["z"]
    with pytest.raises(ValueError, match="test: here has no field z; it has x, y, intensity, ring, t"):
        scan(fields)
    fields["z"] = fields["x"]
    del fields["intensity"]
    with pytest.raises(ValueError, match=r"has no field intensity; .* --log.intensity"):
        scan(fields)


def test_points_that_are_none_leave_cells_empty(fields):
    fields["x"][0], fields["x"][40] = np.nan, np.inf
    for axis in "xyz":
        fields[axis][100] = 0
    assert (~swept(fields).image.valid).sum() == 3
