"""Frames that do not fit are judged block by block: sums do not depend on the blocks, and one is held at a time."""

import shutil
from dataclasses import replace

import jax
import numpy as np
import pytest

from jaxsim.data.polar_frames import open_polar_frames, write_frame, write_grid
from jaxsim.discover import read
from jaxsim.discover.find.division import NOTHING_YET, Division, NullModel
from jaxsim.discover.model.cast import cast
from jaxsim.discover.model.null_model import refit
from jaxsim.discover.model.parameters import to_z
from jaxsim.discover.mounting.constant import Mounting
from jaxsim.discover.read import read_comparison
from jaxsim.discover.show import every_frame
from jaxsim.discover.show.every_frame import HeldAnswer, JudgedRest, block_of, judge_rest
from jaxsim.effects import get_effect
from jaxsim.frame import PolarImage
from tests.discover.toy import toy

pytestmark = pytest.mark.long

FRAMES, READ, ODD = 16, 10, 11
"""Frames in the folders, those that fit, and the one whose beams are dark."""


@pytest.fixture(scope="module")
def judged(tmp_path_factory, standard_promotion):
    """The comparison of those that fit, and an answer (the true gains of the beams) to judge the others by."""
    folder = tmp_path_factory.mktemp("many")
    scan, measured = toy(FRAMES, gain=0.2)
    about = {f"f{k:02d}": {"scene": f"street{k}"} for k in range(FRAMES)}
    for side in ("simulated", "measured"):
        write_grid(folder / side, scan.grid, frames=about)
    for k, name in enumerate(about):
        rasters = {part: getattr(scan, part)[k] for part in ("semantic", "instance")}
        image = PolarImage(scan.range_m[k], scan.intensity[k], scan.hit[k])
        write_frame(folder / "simulated", name, image, incidence=scan.incidence_rad[k], **rasters)
        seen = PolarImage(measured.range_m[k], measured.intensity[k], measured.valid[k])
        if k == ODD:
            seen = replace(seen, intensity=seen.intensity * np.linspace(0.9, 0.3, len(seen.intensity))[:, None])
        write_frame(folder / "measured", name, seen)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(read, "FEWEST_FRAMES", READ)
        patch.setattr(read, "MOST_CELLS", 0)
        comparison = read_comparison(folder / "simulated", folder / "measured")
    null_model = NullModel.of(Division.of(comparison))
    effect = get_effect("beam_gain")
    start = to_z(effect, {}, null_model.problem.ev.rays.row.shape[-1])
    chain = [(one.effect, one.fit.z) for one in refit(null_model.problem, [effect], [start])]
    return comparison, HeldAnswer(null_model, chain, null_model.problem.noise)


@pytest.fixture(scope="module")
def by_two(judged):
    """What is told with two frames at a time, and how many were read each time."""
    taken = []

    def counted(rest, names, like):
        taken.append(len(names))
        return read.read_part(rest, names, like)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(every_frame, "read_part", counted)
        return rest_of(judged, 2), taken


def rest_of(judged, size):
    comparison, by = judged
    return judge_rest(comparison, Mounting((), comparison, NOTHING_YET), by, size=size)


def test_all_frames_that_were_not_read_are_judged_two_at_a_time(judged, by_two):
    comparison, _ = judged
    assert len(comparison.rest.names) == FRAMES - READ
    (told, (before, after), left_out), taken = by_two
    assert left_out == ()
    assert taken == [2, 2, 2]
    assert told.frames == told.scenes == told.unseen == FRAMES - READ
    assert told.gained["intensity"].low > 0
    assert told.after["intensity"].value < 0.7 * told.before["intensity"].value
    # Each beam's own residual is gone.
    rows = [np.nanstd(np.nanmean(side["intensity"], axis=1)) for side in (before, after)]
    assert rows[1] < 0.5 * rows[0]


def test_sums_do_not_depend_on_the_blocks(judged, by_two):
    # Five at a time: the last block is filled up with a frame that counts once.
    (few, few_maps, _), (many, many_maps, _) = by_two[0], rest_of(judged, 5)
    assert many.frames == few.frames
    for name, one in many.gained.items():
        assert few.gained[name].value == pytest.approx(one.value, rel=0.03, abs=0.3), name
    for name, one in many.after.items():
        assert few.after[name].value == pytest.approx(one.value, rel=0.03), name
    assert few.worst[0].name == many.worst[0].name
    assert few_maps[0].keys() == many_maps[0].keys()


def test_a_frame_that_the_answer_serves_ill_is_listed_first(judged, by_two):
    told = by_two[0].every
    assert f"f{ODD:02d}" in judged[0].rest.names
    assert (told.worst[0].name, told.worst[0].scene) == (f"f{ODD:02d}", f"street{ODD}")
    assert told.worst[0].nats < told.worst[1].nats


def test_frames_that_were_traced_before_stand_beside_new_ones_as_if_traced_together(judged):
    comparison, by = judged
    rest = comparison.rest
    mounting = Mounting((), comparison, NOTHING_YET)
    division = block_of(comparison, mounting, rest, names=rest.names[2:4], by=by, size=2, number=1).division
    assert division.names[-2:] == rest.names[2:4]
    together = cast(division.scan, division.blocks.frame, division.blocks.column)
    for one, other in zip(jax.tree.leaves(division.rays), jax.tree.leaves(together), strict=True):
        # Traced with other frames, a compiler may round otherwise.
        np.testing.assert_allclose(one, other, rtol=1e-4, atol=1e-4)


def test_where_all_frames_fit_nothing_is_left_to_judge(judged):
    comparison, by = judged
    whole = replace(comparison, rest=None)
    assert judge_rest(whole, Mounting((), whole, NOTHING_YET), by) == JudgedRest()


def test_a_frame_that_cannot_be_read_costs_itself_alone(judged, tmp_path):
    comparison, by = judged
    folders = {side: tmp_path / side for side in ("simulated", "measured")}
    for side, folder in folders.items():
        shutil.copytree(getattr(comparison.rest, side).folder, folder)
    cut, classless, *others = comparison.rest.names
    whole = (folders["measured"] / f"{cut}.npz").read_bytes()
    (folders["measured"] / f"{cut}.npz").write_bytes(whole[: len(whole) // 2])
    image, rasters = comparison.rest.simulated.read(classless)
    del rasters["semantic"]
    write_frame(folders["simulated"], classless, image, **rasters)
    sides = {side: open_polar_frames(folder) for side, folder in folders.items()}
    damaged = replace(comparison, rest=replace(comparison.rest, **sides))
    found = judge_rest(damaged, Mounting((), damaged, NOTHING_YET), by, size=2)
    assert found.every.frames == len(others)
    assert f"{cut}.npz" in found.left_out[0]
    assert found.left_out[1] == f"{classless} of {folders['simulated']} lacks semantic"
