"""Frames of the same name that do not show the same street. The streets are the generator's own."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.blind.hidden.case import make_case
from jaxsim.data.polar_frames import frame_names, read_frame, read_grid, write_frame, write_grid
from jaxsim.discover.read import read_comparison
from jaxsim.discover.read.checks import agreement, check_instances, check_partners
from tests.discover.rooms import registered, rooms, seen

SMALL = {"seed": 11, "scenes": 6, "rows": 16, "columns": 96}


def sides(folder: Path):
    """(names, simulated, measured) frames of a case."""
    names = frame_names(folder / "simulated")
    return names, *([read_frame(folder / side, name)[0] for name in names] for side in ("simulated", "measured"))


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    folder = tmp_path_factory.mktemp("streets") / "case"
    make_case(folder, effect="none", **SMALL)
    return sides(folder)


def test_pairs_of_one_street_pass(case):
    assert check_partners(*case) == {}


@pytest.mark.parametrize("effect", ["extrinsic_rotation", "motion_distortion", "precipitation_clutter", "range_scale"])
def test_strong_effects_pass(tmp_path, effect):
    make_case(tmp_path / "case", effect=effect, severity=4.0, **SMALL)
    assert check_partners(*sides(tmp_path / "case")) == {}


@pytest.mark.parametrize("share", [0.3, 0.6])
def test_dense_fog_passes(case, share):
    names, ours, theirs = case
    rng = np.random.default_rng(0)
    foggy = []
    for image in theirs:
        early = rng.random(image.valid.shape) < share
        fog_m = rng.uniform(0.5, 3, image.valid.shape).astype(np.float32)
        foggy.append(image.replace(range_m=np.where(early, np.minimum(fog_m, image.range_m), image.range_m)))
    assert check_partners(names, ours, foggy) == {}
    # In fog in one frame alone as well.
    assert check_partners(names, ours, [*foggy[:1], *theirs[1:]]) == {}


def test_two_frames_under_each_others_names_are_told_with_their_true_partners(case):
    names, ours, theirs = case
    found = check_partners(names, ours, [theirs[1], theirs[0], *theirs[2:]])
    assert set(found) == {names[0], names[1]}
    assert f"measured {names[0]} agrees with simulated {names[1]} on" in found[names[0]]


def test_a_single_frame_of_another_street_is_told(case):
    names, ours, theirs = case
    mirrored = theirs[2].replace(**{k: getattr(theirs[2], k)[:, ::-1] for k in ("range_m", "intensity", "valid")})
    found = check_partners(names, ours, [*theirs[:2], mirrored, *theirs[3:]])
    assert set(found) == {names[2]}
    assert "do not show the same street" in found[names[2]]


@pytest.mark.parametrize("by", [1, 2, 5])
def test_measured_frames_under_each_others_names(case, by):
    names, ours, theirs = case
    with pytest.raises(ValueError, match=r"do not show the same street.*--unpaired"):
        check_partners(names, ours, theirs[by:] + theirs[:by])


def test_streets_that_share_much_road_are_told_by_their_true_partners(case):
    names, ours, theirs = case
    # A window of which nine rows in ten are road, the same in all frames.
    road = np.linspace(30, 4, 160, dtype=np.float32)[:, None] * np.ones((1, 96), np.float32)

    def widened(image):
        whole = {"range_m": road, "intensity": np.full_like(road, 0.2), "valid": np.ones(road.shape, bool)}
        return image.replace(**{key: np.concatenate([getattr(image, key), more]) for key, more in whole.items()})

    ours, theirs = ([widened(image) for image in side] for side in (ours, theirs))
    check_partners(names, ours, theirs)
    # Too little of the image tells: nothing is claimed.
    check_partners(names, ours, theirs[1:] + theirs[:1])
    ours, theirs = ([image.replace(**{k: getattr(image, k)[:40] for k in ("range_m", "intensity", "valid")})
                     for image in side] for side in (ours, theirs))  # fmt: skip
    with pytest.raises(ValueError, match="agrees with simulated"):
        check_partners(names, ours, theirs[1:] + theirs[:1])


def test_no_common_rays(case):
    names, ours, theirs = case
    left = np.arange(96)[None, :] < 48
    halves = [
        [image.replace(valid=image.valid & keep) for image in side] for side, keep in ((ours, left), (theirs, ~left))
    ]
    with pytest.raises(ValueError, match="only 0 on the same rays"):
        check_partners(names, *halves)


def test_agreement_is_half_a_metre_or_a_twentieth():
    ours = np.array([4.0, 4.0, 40.0, 40.0, 40.0, 9.0], np.float32)
    theirs = np.array([4.4, 4.6, 41.9, 42.1, 30.0, 90.0], np.float32)
    found = agreement(ours, theirs, np.array([True] * 5 + [False]))
    assert found.near == pytest.approx(0.4)
    assert found.beyond == pytest.approx(0.4)


def test_a_sensor_mounted_half_a_degree_and_more_off_shows_the_same_street():
    streets = rooms(6)
    names = [f"s{k}" for k in range(6)]
    ours = [seen(room) for room in streets]
    theirs = [seen(room, np.array([0, 0, 0, 0.03, -0.03, 0.01])) for room in streets]
    with pytest.raises(ValueError, match="do not show the same street"):
        check_partners(names, ours, theirs)
    check_partners(names, ours, theirs, registered=registered(ours, theirs, names))


def test_a_sensor_half_a_metre_lower_is_no_error_of_units():
    names = [f"s{k}" for k in range(6)]
    ours = [seen(room) for room in rooms(6)]
    theirs = [seen(room, np.array([0, 0, -0.5, 0, 0, 0])) for room in rooms(6)]
    check_partners(names, ours, theirs, registered=registered(ours, theirs, names))


def test_another_street_is_refused_with_the_best_motion_found():
    names = [f"s{k}" for k in range(6)]
    ours = [seen(room) for room in rooms(6)]
    theirs = [seen(room[::-1] * 0.6) for room in rooms(6, seed=9)]
    found = registered(ours, theirs, names)
    with pytest.raises(ValueError, match=r"half the frames; check that names"):  # none that betters anything
        check_partners(names, ours, theirs, registered=found)
    some = np.arange(found.measured_m.shape[1]) < 0.6 * found.measured_m.shape[1]
    better = replace(found, predicted_m=np.where(some, found.measured_m, 2 * found.measured_m))
    with pytest.raises(ValueError, match=r"on 6. % with the simulated sensor moved by .* deg in roll"):
        check_partners(names, ours, theirs, registered=better)


def test_cosines_in_place_of_angles_are_told(tmp_path):
    folder = tmp_path / "case"
    make_case(folder, effect="none", **SMALL)
    simulated, measured = folder / "simulated", folder / "measured"
    read_comparison(simulated, measured)
    for name in frame_names(simulated):
        image, rasters = read_frame(simulated, name)
        write_frame(simulated, name, image, **rasters | {"incidence": np.cos(rasters["incidence"])})
    with pytest.raises(ValueError, match=r"falls where its range image says .* take arccos of cosines"):
        read_comparison(simulated, measured)


def test_a_scene_is_the_same_as_a_number_and_as_a_text(tmp_path):
    folder = tmp_path / "case"
    make_case(folder, effect="none", **SMALL)
    for side, kind in (("simulated", int), ("measured", str)):
        grid, about = read_grid(folder / side)
        names = frame_names(folder / side)
        facts = {name: {**about.get(name, {}), "scene": kind(k // 2)} for k, name in enumerate(names)}
        write_grid(folder / side, grid, frames=facts)
    assert read_comparison(folder / "simulated", folder / "measured").scenes == ("0", "0", "1", "1", "2", "2")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda raster: raster[::-1], "rows from the bottom up"),
        (lambda raster: raster[:, ::-1], "columns from right to left"),
        (lambda raster: np.roll(raster, raster.shape[1] // 2, axis=1), "columns half a turn on"),
    ],
)
def test_a_side_that_is_written_in_another_order_is_told(case, change, words):
    names, ours, theirs = case
    parts = ("range_m", "intensity", "valid")
    other = [image.replace(**{part: change(getattr(image, part)) for part in parts}) for image in theirs]
    with pytest.raises(ValueError, match=rf"do not show the same street.* % with the measured {words}"):
        check_partners(names, ours, other)


def test_a_number_for_all_that_is_no_object_is_told(tmp_path):
    folder = tmp_path / "case"
    make_case(folder, effect="none", **SMALL)
    name = frame_names(folder / "simulated")[0]
    image, rasters = read_frame(folder / "simulated", name)
    check_instances(name, image, rasters=rasters)
    numbered = rasters | {"instance": rasters["instance"] + 7}
    with pytest.raises(ValueError, match=r"instance 7 of .* classes: what is no object is 0"):
        check_instances(name, image, rasters=numbered)
    # A bus that is near may hide most of the street, and frames without classes tell nothing.
    bus = np.full_like(rasters["semantic"], 28)
    check_instances(name, image, rasters=numbered | {"semantic": bus})
    check_instances(name, image, rasters={"instance": numbered["instance"]})
