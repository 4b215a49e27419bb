"""What is told of frames that are compared all the same. The streets are the generator's own."""

import numpy as np
import pytest

from jaxsim.discover.read.notes import brightness, fading, same_numbers, seconds_apart, uneven, very_fast
from tests.discover.rooms import rooms, seen


@pytest.fixture(scope="module")
def case():
    """Names and the two sides of frames that differ by their noise."""
    rng = np.random.default_rng(5)
    ours = [seen(room) for room in rooms(6)]

    def noisy(values):
        return (values * (1 + 0.05 * rng.standard_normal(values.shape))).astype(np.float32)

    theirs = [image.replace(intensity=noisy(image.intensity), range_m=noisy(image.range_m)) for image in ours]
    return [f"s{k}" for k in range(6)], ours, theirs


def brighter(image, factor):
    return image.replace(intensity=np.clip(image.intensity * factor, 0, 1).astype(np.float32))


def test_frames_of_another_brightness_are_told(case):
    names, ours, theirs = case
    assert uneven(names, brightness(ours, theirs)) == []
    # One gain of all frames is fitted first, and is no news.
    assert uneven(names, brightness(ours, [brighter(image, 0.3) for image in theirs])) == []
    (one,) = uneven(names, brightness(ours, [brighter(theirs[0], 1 / 255), *theirs[1:]]))
    assert one.startswith(
        f"1 measured frame of another brightness than the others, beside the simulated ones ({names[0]}"
    )
    (half,) = uneven(names, brightness(ours, [brighter(image, 0.3 if k % 2 else 1) for k, image in enumerate(theirs)]))
    assert "differs from frame to frame" in half


def test_drives_that_all_grow_darker_are_told_and_one_that_does_not_ends_that():
    rng = np.random.default_rng(0)
    scenes = [f"drive {k // 6}" for k in range(24)]
    facts = [{"time": 1000.0 * (k // 6) + 8 * (k % 6)} for k in range(24)]
    since = 8.0 * (np.arange(24) % 6)
    noise = rng.normal(0, 0.03, 24)
    warming = noise - 0.6 * (1 - np.exp(-since / 16))
    (note,) = fading(scenes, facts, warming)
    assert "grow darker beside the simulated ones in the course of each of 4 drives" in note
    # Frames of which nothing is known are passed over.
    assert fading(scenes, facts, np.where(np.arange(24) == 3, np.nan, warming))
    assert "brighter" in fading(scenes, facts, -warming)[0]
    other_way = np.where(np.arange(24) < 6, -warming, warming)
    few = 12
    for quiet in (noise, other_way, 0.1 * warming):
        assert fading(scenes, facts, quiet) == []
    assert fading(scenes[:few], facts[:few], warming[:few]) == []
    assert fading(scenes, [{}] * 24, warming) == []


def test_frames_without_returns_have_no_brightness(case):
    names, ours, theirs = case
    dark = [image.replace(valid=np.zeros_like(image.valid)) for image in theirs]
    assert uneven(names, brightness(ours, dark)) == []
    assert uneven(names, brightness(ours, [dark[0], *theirs[1:]])) == []


def test_speeds_in_kilometres_an_hour_are_asked_about():
    assert very_fast(np.array([0.0, 13.9, np.nan])) == []
    assert very_fast(np.zeros(0)) == []
    (note,) = very_fast(np.array([50.0, -70.0]))
    assert note.startswith("speeds in grid.json reach 70 m/s (252 km/h)")


def test_copied_numbers_are_told(case):
    _, ours, theirs = case
    assert same_numbers(ours, theirs) == []
    painted = [image.replace(intensity=other.intensity) for image, other in zip(ours, theirs, strict=True)]
    (note,) = same_numbers(painted, theirs)
    assert note.startswith("100 % of the rays that return on both sides have the same number as intensities")
    # A few cells that were edited do not hide it.
    edited = [image.replace(intensity=np.where(image.range_m < 3, 0.5, image.intensity)) for image in painted]
    assert len(same_numbers(edited, theirs)) == 1
    assert len(same_numbers(theirs, theirs)) == 2


def test_noise_that_is_rounded_away_is_no_copy(case):
    _, ours, theirs = case

    def in_steps(images):
        return [image.replace(intensity=np.round(255 * image.intensity) / 255) for image in images]

    assert same_numbers(in_steps(ours), in_steps(theirs)) == []


def test_how_far_apart_frames_are_is_told_of_those_that_name_no_scene():
    assert seconds_apart([{"time": 0.5 * k} for k in (3, 0, 1, 2)]) == 0.5
    assert seconds_apart([{"time": 0.1 * k, "scene": "a"} for k in range(4)] + [{"time": 5.0}, {"time": 8.0}]) == 3.0
    for silent in ([], [{}] * 3, [{"time": 0.0}] * 4):
        assert seconds_apart(silent) == np.inf
