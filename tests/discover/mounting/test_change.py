"""A sensor that stands otherwise from a moment on, or in the frames of a tag: found, put in place, and told."""

from dataclasses import replace

import numpy as np
import pytest

from jaxsim.discover.mounting.change import apart, find_knock, named_knock
from jaxsim.discover.mounting.constant import OF_POSE
from jaxsim.discover.read import Comparison
from jaxsim.discover.scenes import split_scenes
from jaxsim.discover.verdict import Interval
from jaxsim.effects.region import Region
from jaxsim.effects.scan import scan_of
from tests.discover.rooms import GRID, measured_of, registered, rooms, seen

pytestmark = [pytest.mark.long, pytest.mark.usefixtures("standard_promotion")]
NAMES = tuple(f"d{k:02d}" for k in range(16))
KNOCKED = np.arange(16) >= 9
PITCH = (0, 0, 0, 0, 0.009, 0)
PARTS = split_scenes(NAMES)


def drives(off, *, elsewhere=(0.0,) * 6, tagged=None) -> Comparison:
    """Rooms seen from the pose `off` by the knocked drives and from `elsewhere` by the others, ten minutes apart."""
    rng = np.random.default_rng(4)
    streets = rooms(len(NAMES))
    poses = [off if one else elsewhere for one in (KNOCKED if tagged is None else tagged)]
    ours = [seen(room) for room in streets]
    theirs = [seen(room, pose, noise_m=0.02, rng=rng) for room, pose in zip(streets, poses, strict=True)]
    scan = scan_of(GRID, ours)
    facts = {"time_s": 600 * np.arange(16, dtype=np.float32)} if tagged is None else {"tags": {"rain": tagged}}
    scan = replace(scan, **facts)
    return Comparison(scan, measured_of(theirs), NAMES, NAMES, registration=registered(ours, theirs, NAMES))


@pytest.fixture(scope="module")
def pitched(standard_promotion) -> Comparison:
    """A sensor that was pitched between two drives."""
    return drives(PITCH)


def off_m(one: Comparison) -> np.ndarray:
    both, sides = one.scan.hit & one.measured.valid, (one.scan.range_m, one.measured.range_m)
    return np.array([np.median(np.abs(s - m)[b]) for s, m, b in zip(*sides, both, strict=True)])


def test_a_sensor_that_was_knocked_is_put_in_place_from_that_moment_on(pitched):
    knock = find_knock(pitched, OF_POSE, PARTS)
    assert knock is not None
    assert (knock.effects, knock.divides) == (("extrinsic_rotation",), "time")
    assert knock.where == Region(time_s=(5100.0, None))
    assert knock.registered.motion[4] == pytest.approx(0.009, abs=0.0005)
    brought = knock.brought(pitched)
    assert off_m(pitched)[KNOCKED].min() > 0.02
    assert off_m(brought)[KNOCKED].max() < 0.02
    np.testing.assert_array_equal(brought.scan.range_m[~KNOCKED], pitched.scan.range_m[~KNOCKED])


def test_it_is_named_with_its_regime(pitched):
    knock = find_knock(pitched, OF_POSE, PARTS)
    assert knock is not None
    (turn,), unsure, (regime,) = named_knock(knock, knock.brought(pitched), PARTS)
    assert not unsure
    assert turn.name == regime.effect == "extrinsic_rotation"
    pitch = turn.parameters["pitch_rad"]
    assert isinstance(pitch, Interval)
    assert pitch.low < 0.009 < pitch.high
    assert turn.gain.value == pytest.approx(0.5 * 9**2, rel=0.15)
    assert regime.inside.low < 1 < regime.inside.high
    assert abs(regime.outside.value) < 0.1
    assert regime.held == tuple(KNOCKED.tolist())
    assert regime.share == pytest.approx(7 / 16)
    assert regime.judge_nats > 10


def test_frames_of_a_tag_may_stand_otherwise():
    tagged = np.isin(np.arange(16), [1, 2, 6, 8, 11, 13, 15])
    knock = find_knock(drives((0.2, 0, 0, 0, 0, 0), tagged=tagged), OF_POSE, PARTS)
    assert knock is not None
    assert (knock.effects, knock.divides, knock.where) == (("extrinsic_translation",), "tag", Region(tag="rain"))
    assert knock.registered.motion[0] == pytest.approx(0.2, abs=0.03)


@pytest.mark.parametrize(
    "given",
    [
        {"off": (0.0,) * 6},
        {"off": PITCH, "elsewhere": PITCH},
        # Off on both sides of the moment.
        {"off": PITCH, "elsewhere": (0, 0, 0, 0, -0.009, 0)},
    ],
)
def test_where_it_stands_as_everywhere_nothing_is_found(given):
    assert find_knock(drives(**given), OF_POSE, PARTS) is None


def test_what_is_known_already_is_not_found_again(pitched):
    assert find_knock(pitched, ["extrinsic_translation"], PARTS) is None


def test_of_few_drives_nothing_is_asked(pitched):
    few = replace(pitched, scenes=tuple(f"drive {k // 4}" for k in range(16)))
    assert find_knock(few, OF_POSE, PARTS) is None


def test_alike_scenes_are_divided_as_rarely_as_the_rule_says():
    whole = np.tri(10, 13, dtype=bool)[2:]
    chances = [apart(np.random.default_rng(seed).normal(0, 1, (13, 6)), whole)[1] for seed in range(60)]
    # More than nine of 60 at one in twenty are a matter of one in a thousand.
    assert sum(chance <= 0.05 for chance in chances) <= 9


def test_scenes_that_lie_elsewhere_are_told_and_one_alone_decides_nothing():
    z = np.random.default_rng(1).normal(0, 1, (13, 6))
    whole = np.tri(13, dtype=bool)[2:-3]
    best, chance = apart(z + 6 * whole[4][:, None] * np.array([0, 0, 0, 1, -1, 0]), whole)
    assert best == 4
    assert chance < 0.005
    z[0] += 50
    assert apart(z, whole)[1] > 0.05
