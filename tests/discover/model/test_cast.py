"""Which columns are looked at, and rays that know how a pose changes them."""

from itertools import pairwise

import jax
import numpy as np
import pytest

from jaxsim.discover.model.cast import RAYS, blocks, cast, ray_index, seeing
from jaxsim.discover.model.evidence import gather
from jaxsim.discover.rules import RULES
from tests.discover.toy import device, toy

COLUMNS = np.broadcast_to(np.arange(0, 60, 4), (6, 15))
FRAMES = np.arange(6)


def test_a_single_scan_is_cut_into_sectors_with_gaps_between():
    cut = blocks(["drive"], 64, 1024)
    assert len(set(cut.scene)) == RULES.sectors
    for left, right in zip(cut.column, cut.column[1:], strict=False):
        assert right.min() - left.max() > RULES.guard_columns


def test_a_narrow_single_scan_is_an_error():
    with pytest.raises(ValueError, match="too narrow"):
        blocks(["drive"], 64, 120)


@pytest.mark.parametrize("frames", [1, 2, 6, 200])
def test_frames_of_one_drive_are_cut_into_the_same_sectors(frames):
    cut = blocks(["drive"] * frames, 44, 372)
    assert cut.frame.tolist() == [f for f in range(frames) for _ in range(RULES.sectors)]
    assert len(cut.scene) == len(cut.column) == frames * RULES.sectors
    of_scene = {name: cut.column[[scene == name for scene in cut.scene]] for name in set(cut.scene)}
    assert len(of_scene) == RULES.sectors
    spans = sorted((columns.min(), columns.max()) for columns in of_scene.values())
    assert all(right[0] - left[1] > 2 * RULES.guard_columns for left, right in pairwise(spans))
    assert all(columns.size >= RULES.fewest_columns for columns in of_scene.values())
    assert cut.column.size * 44 <= max(RAYS, RULES.sectors * frames * 44)
    # No column twice in a block.
    assert all(len(set(columns)) == len(columns) for columns in cut.column.tolist())


def test_frames_of_enough_drives_keep_their_drives():
    drives = [f"drive {k}" for k in (*range(RULES.fewest_scenes), 0)]
    chosen = blocks(drives, 44, 372)
    assert (chosen.scene, chosen.sectors) == (tuple(drives), 1)


@pytest.mark.parametrize("drives", range(1, RULES.fewest_scenes))
def test_frames_of_few_drives_are_cut_until_there_are_enough_scenes(drives):
    names = [f"drive {k % drives}" for k in range(2 * drives + 1)]
    cut = blocks(names, 44, 372)
    assert RULES.sectors <= len(set(cut.scene)) < RULES.sectors + drives
    assert len(cut.scene) == len(names) * cut.sectors
    for scene in set(cut.scene):
        mine = [k for k, name in enumerate(cut.scene) if name == scene]
        assert len({names[cut.frame[k]] for k in mine}) == 1, "a scene is of one drive"
        assert cut.column[mine].size >= RULES.fewest_columns


def test_further_frames_are_cut_as_those_that_were_read():
    read = blocks(["a", "a", "b"], 44, 372)
    rest = blocks(["b", "b", "b", "b"], 44, 372, like=read)
    assert rest.column.shape[1] == read.column.shape[1]
    assert set(rest.scene) == {name for name in read.scene if name.startswith("b ")}


def test_what_is_hidden_between_the_columns_is_seen_by_every_frame():
    chosen = blocks([f"drive {k}" for k in range(12)], 44, 372, rays=44 * 12 * RULES.fewest_columns)
    hidden = np.zeros(372, bool)
    hidden[100:103] = True
    seen = seeing(chosen, hidden)
    assert not hidden[chosen.column].any(1).all()
    assert hidden[seen.column].any(1).all()
    assert set(seen.column[hidden[seen.column]].tolist()) == {100, 101, 102}
    assert (seen.column != chosen.column).sum(1).max() == 1
    np.testing.assert_array_equal(seeing(chosen, np.zeros(372, bool)).column, chosen.column)


def test_rays_are_the_cells_of_whole_columns():
    scan, _ = toy()
    index = ray_index(scan, FRAMES, COLUMNS)
    for b, c, r in ((0, 0, 0), (3, 2, 5), (5, 14, 15)):
        assert tuple(int(part[b, c, r]) for part in index) == (b, r, COLUMNS[b, c])
    rays = cast(*device(scan), FRAMES, COLUMNS).rays
    np.testing.assert_array_equal(np.asarray(rays.range_m), scan.range_m[index])


def test_rays_that_were_cast_with_other_frames_give_the_same_evidence():
    scan, measured = device(*toy())
    alone = gather(scan, measured, frame=FRAMES[1:], column=COLUMNS[1:], scene=FRAMES[1:])
    rays = cast(scan, FRAMES, COLUMNS).part(FRAMES > 0)
    shared = gather(scan, measured, frame=FRAMES[1:], column=COLUMNS[1:], scene=FRAMES[1:], rays=rays)
    for one, other in zip(jax.tree.leaves(alone), jax.tree.leaves(shared), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-5, atol=1e-5)


def test_pose_derivatives_are_those_of_a_road(evidence):
    """Lifting the sensor by dz lengthens a ray that looks down by e to the road by dz / sin e."""
    road = np.asarray((evidence.rays.semantic == 7) & ~evidence.edge)
    down = -np.sin(np.asarray(evidence.rays.elevation_rad))
    np.testing.assert_allclose(np.asarray(evidence.pose[..., 2])[road], 1 / down[road], rtol=0.03)
    # Pitching (about y, nose down positive) by w lowers a forward ray: the road is nearer by r cos / sin.
    ahead = road & (np.abs(np.asarray(evidence.rays.azimuth_rad)) < 0.2)
    slope = np.asarray(evidence.rays.range_m) / np.tan(-np.asarray(evidence.rays.elevation_rad))
    cosine = np.cos(np.asarray(evidence.rays.azimuth_rad))
    np.testing.assert_allclose(np.asarray(evidence.pose[..., 4])[ahead], -(slope * cosine)[ahead], rtol=0.03)
