"""A mounting that is off by the same in all scenes, put in place and priced; frames as they would be seen from
elsewhere, held against frames that were cast there."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxsim.discover.find.division import NOTHING_YET, Division
from jaxsim.discover.find.levels import compare_levels
from jaxsim.discover.model.evidence import POSE_SD, Measured
from jaxsim.discover.model.fit import Problem
from jaxsim.discover.model.noise_levels import lattices_of
from jaxsim.discover.mounting import constant
from jaxsim.discover.mounting.constant import (
    BY_FRAMES,
    LIFT_OF_ALL,
    brought_back,
    gains,
    how_placed,
    named_mounting,
    place_mounting,
    refine_lift,
    registered_of,
    seen_from,
)
from jaxsim.discover.read.registration import LIFT, MOTION_PARTS
from jaxsim.discover.scenes import p_value, split_scenes
from jaxsim.discover.verdict import Interval
from jaxsim.effects import EFFECTS, all_rays
from jaxsim.effects.chain import SensorModel
from jaxsim.effects.region import Region
from jaxsim.effects.scan import scan_of
from jaxsim.frame import PolarImage
from tests.discover.rooms import GRID, NAMES, comparison, off_m, rooms, seen

pytestmark = pytest.mark.usefixtures("standard_promotion")
POSES = np.array([[0.4, -0.2, 0.1, 0, 0, 0], [0, 0, 0, 0.01, -0.005, 0.03], [3.0, 0, 0, 0, 0, 0.02]])


def test_a_turned_sensor_is_named_with_its_interval_and_its_frames_are_brought_there():
    one = place_mounting(comparison([0, 0, 0, 0, 0.0087, 0]), MOTION_PARTS)
    assert one.effects == ("extrinsic_rotation",)
    assert off_m(one.comparison) < 0.02
    (turn,), unsure = named_mounting(one, split_scenes(NAMES), rows=24)
    assert not unsure
    pitch = turn.parameters["pitch_rad"]
    assert isinstance(pitch, Interval)
    assert pitch.low < 0.0087 < pitch.high
    assert pitch.high - pitch.low < 0.002
    assert turn.gain.value == pytest.approx(0.5 * 8.7**2, rel=0.15)
    told = registered_of(one.comparison)
    assert told is not None
    assert told.motion["pitch_rad"] == pitch
    assert told.near[1] > told.near[0]
    assert told.off_m[1] < told.off_m[0]


def test_lattices_that_both_sides_have_are_not_lost_between_two_readings():
    """What is read between two readings of a lattice lies on none."""
    one = comparison([0, 0, 0, 0, 0.0087, 0])
    step = 0.02
    rng = np.random.default_rng(3)
    ours, theirs = (step * rng.integers(5, 40, one.scan.range_m.shape) for _ in range(2))
    scan = replace(one.scan, intensity=ours.astype(np.float32))
    measured = replace(one.measured, intensity=theirs.astype(np.float32))
    placed = place_mounting(replace(one, scan=scan, measured=measured), MOTION_PARTS).comparison
    assert lattices_of(placed.scan).intensity_step == 0
    assert Division.of(placed).simulator.noise.intensity_step == pytest.approx(step, rel=1e-4)
    lattice = {level.name: level for level in compare_levels(placed)}["intensity_step"]
    assert lattice.simulated.value == pytest.approx(step, rel=1e-4)
    assert lattice.missing.value == 0


def test_beams_that_all_point_higher_are_named_for_each_beam():
    one = place_mounting(comparison(np.zeros(6), lift=0.0087), MOTION_PARTS)
    assert one.effects == ("beam_elevation_error",)
    assert off_m(one.comparison) < 0.02
    (lift,), _ = named_mounting(one, split_scenes(NAMES), rows=24)
    beams = lift.parameters["error_rad"]
    assert isinstance(beams, tuple)
    assert len(beams) == 24
    # Rows of this room are 20 mrad apart.
    assert beams[5].value == pytest.approx(0.0087, abs=1.5e-3)


def test_a_lift_is_fitted_to_what_the_registration_left(monkeypatch):
    given = comparison(np.zeros(6), lift=0.0087)
    coarse = replace(given.registration, motion=given.registration.motion + np.eye(8)[LIFT] * 3e-4)
    given = replace(given, registration=coarse)
    one = place_mounting(given, MOTION_PARTS)
    asked = []

    def fit(law, null):
        asked.append(law.name)
        return SimpleNamespace(z={"error_rad": np.float32(-3e-4 / 0.0014)})

    monkeypatch.setattr(constant, "fit", fit)
    null = object.__new__(Problem)
    finer = refine_lift(given, one, null, known=NOTHING_YET)
    assert asked == ["lift"]
    assert finer.effects == one.effects
    assert finer.comparison.registration.motion[LIFT] == pytest.approx(coarse.motion[LIFT] - 3e-4, abs=1e-7)
    assert finer.comparison.told is not None
    # Steps to the sides are where they were.
    assert not finer.comparison.between_unknown
    turned = place_mounting(comparison([0, 0, 0, 0, 0.0087, 0]), MOTION_PARTS)
    assert refine_lift(given, turned, null, known=NOTHING_YET) is turned


def test_all_beams_are_lifted_alike():
    scan = comparison(np.zeros(6)).scan
    rays = all_rays(scan)
    one = LIFT_OF_ALL.apply({"error_rad": np.float32(0.002)}, rays)
    beams = EFFECTS["beam_elevation_error"].apply({"error_rad": np.full(24, 0.002, np.float32)}, rays)
    np.testing.assert_allclose(one.turned_rad, beams.turned_rad, atol=1e-9)


@pytest.mark.parametrize("candidates", [(), ("extrinsic_translation", "beam_gain")])
def test_what_is_no_candidate_is_left(candidates):
    given = comparison([0, 0, 0, 0, 0, 0.02])
    assert place_mounting(given, candidates).comparison is given


def test_a_known_mounting_is_put_in_place_as_it_stands():
    given = comparison([0, 0, 0, 0, 0, 0.02])
    known = SensorModel((("extrinsic_rotation", {"yaw_rad": 0.02}), ("random_dropout", {"probability": 0.1})))
    one = place_mounting(given, ("beam_gain",), known)
    assert one.effects == ()
    assert [name for name, _ in one.known.effects] == ["random_dropout"]
    assert off_m(one.comparison) < 0.02


def test_a_known_turn_of_a_part_of_the_recording_is_no_mounting():
    known = SensorModel(
        (("extrinsic_rotation", {"yaw_rad": 0.02}),), regions={"extrinsic_rotation": Region(time_s=(5.0, None))}
    )
    one = place_mounting(comparison([0, 0, 0, 0, 0, 0.02]), (), known)
    assert (one.effects, one.known) == ((), known)


def test_a_sensor_in_its_place_changes_nothing():
    given = comparison(np.zeros(6))
    one = place_mounting(given, MOTION_PARTS)
    assert one.comparison is given
    assert named_mounting(one, split_scenes(NAMES), rows=24) == ((), ())
    assert registered_of(replace(given, registration=None)) is None


def test_frames_of_other_moments_are_each_brought_to_their_place():
    poses = np.zeros((12, 6))
    poses[:, 0] = np.linspace(0, 4, 12)
    one = place_mounting(comparison(poses), MOTION_PARTS)
    assert one.effects == ()
    assert off_m(one.comparison) < 0.03
    told = registered_of(one.comparison)
    assert told is not None
    assert told.other_moments


def test_exchanged_frames_of_other_moments_are_brought_to_where_the_simulated_ones_stood():
    poses = np.zeros((12, 6))
    poses[:, 0] = np.linspace(0, 4, 12)
    given = comparison(poses)
    placed = place_mounting(given, MOTION_PARTS).comparison
    turned = replace(placed.scan, range_m=placed.measured.range_m, hit=placed.measured.valid)
    theirs = Measured(placed.scan.range_m, placed.scan.intensity, placed.scan.hit)
    back = brought_back(replace(placed, scan=turned, measured=theirs))
    np.testing.assert_array_equal(back.measured.range_m, given.scan.range_m)
    both = np.asarray(back.scan.hit)
    off = {
        name: np.abs(one.range_m - given.scan.range_m)[both].mean()
        for name, one in (("back", back.scan), ("was", turned))
    }
    assert off["back"] < 0.05 < 0.1 < off["was"]


def test_scenes_are_priced_by_what_the_others_say():
    poses = np.zeros((12, 8))
    poses[:, 0] = 0.1
    poses[0, 0] = -0.1
    parts = split_scenes(NAMES)
    find, judge = gains(poses, MOTION_PARTS["extrinsic_translation"], scenes=NAMES, parts=parts)
    nats = 0.5 * (0.1 / POSE_SD[0]) ** 2
    expected = [-3 * nats if name == "s0" else nats for name in (*parts.find, *parts.judge)]
    np.testing.assert_allclose([*find, *judge], expected, rtol=1e-6)


def test_frames_of_one_drive_find_and_judge_in_turn():
    poses = np.full((9, 8), 0.1)
    find, judge = gains(poses, MOTION_PARTS["extrinsic_rotation"], scenes=["drive"] * 9, parts=split_scenes(NAMES))
    assert (len(find), len(judge)) == (6, 3)
    assert how_placed(["drive"] * 9) == f"{how_placed(NAMES)}; {BY_FRAMES}"


@pytest.mark.parametrize("frames", [1, 2])
def test_so_few_frames_of_one_drive_bear_nothing_out(frames):
    poses = np.full((frames, 8), 0.1)
    find, judge = gains(poses, MOTION_PARTS["extrinsic_rotation"], scenes=["drive"] * frames, parts=split_scenes(NAMES))
    assert not find.any()
    assert p_value(find) == 1.0
    assert np.isfinite([*find, *judge]).all()


def effects(poses):
    yaw, pitch, roll = Rotation.from_rotvec(poses[:, 3:]).as_euler("ZYX").T
    x, y, z = poses[:, :3].T
    return {
        "extrinsic_rotation": {"roll_rad": roll, "pitch_rad": pitch, "yaw_rad": yaw},
        "extrinsic_translation": {"x_m": x, "y_m": y, "z_m": z},
    }


def test_ranges_are_those_seen_from_there():
    streets = rooms(3)
    moved, _ = seen_from(scan_of(GRID, [seen(room) for room in streets]), effects(POSES))
    truth = np.stack([np.asarray(seen(r, p).range_m) for r, p in zip(streets, POSES, strict=True)])
    off = np.abs(moved.range_m - truth) / truth
    assert np.median(off) < 1e-4
    assert np.quantile(off, 0.9) < 0.03


def test_lifted_beams_see_what_lies_higher():
    streets = rooms(3)
    lift = {"beam_elevation_error": {"error_rad": np.full(24, 0.0087)}}
    moved, _ = seen_from(scan_of(GRID, [seen(room) for room in streets]), lift)
    truth = np.stack([np.asarray(seen(room, lift=0.0087).range_m) for room in streets])
    assert np.median(np.abs(moved.range_m - truth) / truth) < 1e-4


def test_a_sensor_that_stays_sees_what_it_saw():
    scan = scan_of(GRID, [seen(room) for room in rooms(2)])
    same, told = seen_from(scan, effects(np.zeros((2, 6))))
    np.testing.assert_allclose(same.range_m, scan.range_m, rtol=1e-6)
    np.testing.assert_allclose(same.intensity, scan.intensity, rtol=1e-5)
    np.testing.assert_array_equal(same.semantic, scan.semantic)
    assert told.all()


def test_beyond_the_image_and_where_surfaces_end_nothing_is_told():
    scan = scan_of(GRID, [seen(room) for room in rooms(2)])
    step = GRID.elevation_rad[0] - GRID.elevation_rad[1]
    lift = {"beam_elevation_error": {"error_rad": np.full(24, 4.2 * step)}}
    _, told = seen_from(scan, lift)
    # Two rows beyond the image its surfaces go on.
    assert not told[:, :2].any()
    assert told[:, 3:].mean() > 0.95
    # Where between two beams the ground ends is in no frame.
    down = -np.asarray(GRID.elevation_rad)[:, None] + np.zeros(180)
    flat = np.where(down > 0.02, 1.7 / np.sin(np.maximum(down, 0.02)), 0).astype(np.float32)
    ground = scan_of(GRID, [PolarImage(flat, (flat > 0).astype(np.float32), flat > 0)])
    _, told = seen_from(ground, {"beam_elevation_error": {"error_rad": np.full(24, 0.3 * step)}})
    first = int(np.argmax(down[:, 0] > 0.02))
    np.testing.assert_array_equal(told[0, :, 0], ~np.isin(np.arange(24), (first - 1, first)))
