"""Surfaces that one side alone has, of rooms cast in plain NumPy."""

from dataclasses import replace

import numpy as np
import pytest

from jaxsim.data.cityscapes import IDS
from jaxsim.discover.find.other_surfaces import apart_in_words, met_by_chance, same_surfaces, surfaces_apart
from jaxsim.effects.scan import scan_of
from tests.discover import rooms


@pytest.fixture
def sides():
    """Rooms as a simulator and a sensor see them, alike."""
    streets = rooms.rooms(2)
    seen = [rooms.seen(one) for one in streets]
    return scan_of(rooms.GRID, seen), rooms.measured_of(seen)


def with_clutter(measured, share):
    """Single false returns in front of surfaces, each at a range of its own."""
    rng = np.random.default_rng(4)
    false = rng.random(measured.valid.shape) < share
    at = np.where(false, rng.uniform(0.3, 0.9, false.shape) * measured.range_m, measured.range_m)
    return replace(measured, range_m=at.astype(np.float32)), false


def test_sides_that_see_the_same_have_no_surfaces_apart(sides):
    assert not surfaces_apart(*sides).any()


def test_a_box_that_the_simulator_lacks_is_apart_with_what_is_lost_on_it(sides):
    scan, measured = sides
    box = np.zeros(scan.hit.shape, bool)
    box[:, 4:12, 20:30] = True
    measured.range_m[box] = 0.6 * measured.range_m[box].min()
    measured.valid[0, 7, 25] = False
    np.testing.assert_array_equal(surfaces_apart(scan, measured), box)


def test_a_box_that_the_sensor_does_not_see_is_apart_too(sides):
    scan, measured = sides
    box = np.zeros(scan.hit.shape, bool)
    box[:, 4:12, 20:30] = True
    nearer = np.where(box, np.float32(0.4), 1) * np.asarray(scan.range_m)
    apart = surfaces_apart(replace(scan, range_m=nearer.astype(np.float32)), measured)
    # Of its outermost rays the sensor reads what is simulated beside.
    assert apart[:, 5:11, 21:29].all()
    assert not apart[~box].any()


@pytest.mark.parametrize("share", [0.02, 0.3])
def test_false_returns_that_know_nothing_of_each_other_stay(sides, share):
    scan, measured = sides
    foggy, false = with_clutter(measured, share)
    assert surfaces_apart(scan, foggy).sum() < 0.1 * false.sum()


def test_a_reading_of_the_surface_beside_an_edge_stays(sides):
    scan, measured = sides
    aside = replace(measured, range_m=np.roll(measured.range_m, 1, axis=2))
    aside.range_m[:, :, 0] = measured.range_m[:, :, 0]
    assert (np.abs(aside.range_m - measured.range_m) > 1).any()
    assert not surfaces_apart(scan, aside).any()


def test_glare_around_a_bright_target_stays(sides):
    scan, measured = sides
    halo = np.zeros(scan.hit.shape, bool)
    halo[:, 4:12, 20:30] = True
    measured.range_m[halo] = 0.6 * measured.range_m[halo].min()
    glare_m = np.where(halo, measured.range_m, scan.glare_m).astype(np.float32)
    glare_rad = np.where(halo, 0.05, np.pi).astype(np.float32)
    assert not surfaces_apart(replace(scan, glare_m=glare_m, glare_rad=glare_rad), measured).any()


def test_classes_that_are_apart_most_are_named(sides):
    scan, _ = sides
    apart = np.zeros(scan.hit.shape, bool)
    apart[:, 4:12, 20:30] = True
    semantic = np.where(apart, IDS["terrain"], IDS["road"]).astype(np.int32)
    assert "100 % of terrain" in apart_in_words(apart, replace(scan, semantic=semantic))
    nameless = apart_in_words(apart, replace(scan, semantic=np.zeros_like(semantic)))
    assert nameless == f"{100 * apart.sum() / np.asarray(scan.hit).sum():.1f} % of the rays"


def test_what_moved_is_seen_by_neither_side_and_a_lost_ray_stays_lost():
    streets = rooms.rooms(2)
    scan = scan_of(rooms.GRID, [rooms.seen(room) for room in streets])
    measured = rooms.measured_of([rooms.seen(room) for room in streets])
    moving = np.zeros(scan.hit.shape, bool)
    moving[:, 4:12, 20:30] = True
    measured.range_m[moving] -= 2
    measured.valid[0, 15, 100] = False
    one, other = same_surfaces(scan, measured)
    assert not one.hit[moving].any()
    assert not other.valid[moving].any()
    assert one.hit[0, 15, 100]
    assert not other.valid[0, 15, 100]
    # A ray in a corner of the image has no two neighbours.
    assert (~one.hit[~moving]).sum() == 2 * 4


def test_the_share_of_lost_rays_is_that_of_all():
    scan = scan_of(rooms.GRID, [rooms.seen(room) for room in rooms.rooms(6)])
    measured = rooms.measured_of([rooms.seen(room) for room in rooms.rooms(6)])
    lost = np.random.default_rng(0).random(scan.hit.shape) < 0.1
    measured.range_m[:, 4:12, 20:60] -= 2
    measured.valid[lost] = False
    one, other = same_surfaces(scan, measured)
    kept = np.asarray(one.hit)
    share = 1 - np.asarray(other.valid)[kept].mean()
    assert abs(share - 0.1) < 3 * np.sqrt(0.09 / kept.sum())


def test_leaves_that_the_sensor_alone_met_are_of_the_crown_beside(sides):
    scan, measured = sides
    rng = np.random.default_rng(6)
    crown = np.zeros(scan.hit.shape, bool)
    crown[:, :6, 10:30] = True
    ours = crown & (rng.random(crown.shape) < 0.6)
    theirs = crown & (rng.random(crown.shape) < 0.6)
    hit = np.asarray(scan.hit) & ~crown | ours
    range_m = np.where(ours, 8 + rng.random(crown.shape), np.where(crown, 0, scan.range_m)).astype(np.float32)
    semantic = np.where(crown, np.where(ours, IDS["vegetation"], IDS["sky"]), scan.semantic)
    angle = np.where(ours, np.float32(0.3), scan.incidence_rad)
    scan = replace(scan, hit=hit, range_m=range_m, semantic=semantic, incidence_rad=angle)
    read_m = np.where(theirs, 8.5, np.where(crown, 0, measured.range_m)).astype(np.float32)
    # Something that flies between crown and sensor is of no surface beside.
    alone = theirs & ~ours
    flying = alone & (np.cumsum(alone.reshape(len(alone), -1), axis=1).reshape(alone.shape) % 9 == 0)
    read_m[flying] = 3.0
    met = met_by_chance(scan, replace(measured, range_m=read_m, valid=measured.valid & ~crown | theirs))
    assert flying.any()
    np.testing.assert_array_equal(met.hit, hit | (alone & ~flying))
    assert (np.asarray(met.semantic)[alone & ~flying] == IDS["vegetation"]).mean() > 0.9
    leaves = alone & ~flying & (np.asarray(met.semantic) == IDS["vegetation"])
    assert (np.asarray(met.incidence_rad)[leaves] == np.float32(0.3)).all()
    for name in ("range_m", "semantic", "incidence_rad"):
        np.testing.assert_array_equal(np.asarray(getattr(met, name))[hit], np.asarray(getattr(scan, name))[hit])
