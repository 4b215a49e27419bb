"""The order of channels is fixed, and a black box of the right covariate reaches the noise."""

import numpy as np
import pytest

from jaxsim.discover.likelihood import CHANNELS
from jaxsim.discover.null import fit_null
from jaxsim.discover.residuals import residuals
from jaxsim.discover.show import by_scene, distances, floors, gaps

from .conftest import device, toy


def problem(gain: float):
    import jax

    from jaxsim.discover.evidence import gather

    scan, measured = device(*toy(frames=9, gain=gain))
    frames = np.arange(9)
    ev = gather(scan, measured, frames, np.broadcast_to(np.arange(0, 60, 2), (9, 30)), frames)
    fitted = (frames < 6).astype(np.float32)
    with jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"):
        found, _ = fit_null(scan, ev, fitted)
        per_block = np.asarray(distances(found, fitted))
    return found, fitted, frames >= 6, frames, by_scene(per_block[frames >= 6], frames[frames >= 6])


def test_a_black_box_along_the_rows_takes_beam_gains_and_touches_no_other_channel():
    found, fitted, judged, unit, before = problem(gain=0.3)
    floor = floors(found, fitted, judged, unit, before, ["row"])
    assert list(residuals(found, fitted)) == list(CHANNELS)
    assert floor[:, 0].mean() < 0.5 * before[:, 0].mean()
    np.testing.assert_allclose(floor[:, 1].mean(), before[:, 1].mean(), rtol=0.2)


def test_closure_is_the_share_of_what_can_be_explained():
    before = np.array([[0.2, 0.02, 0.1]] * 4)
    floor = np.array([[0.1, 0.02, 0.1]] * 4)
    after = np.array([[0.12, 0.02, 0.1]] * 4)
    gap, closure = gaps(before, after, before, floor, ["intensity"])
    np.testing.assert_allclose(closure.value, 0.8)
    np.testing.assert_allclose(
        [gap["intensity"].before, gap["intensity"].after, gap["intensity"].win_rate], [0.2, 0.12, 1]
    )
    assert gap["range"].win_rate == 0


def test_a_floor_that_lies_above_what_the_effects_reach_is_given_as_it_is():
    rng = np.random.default_rng(1)
    before, noise = np.full((5, 3), 0.2), rng.normal(0, 0.002, (5, 3))
    gap, closure = gaps(before, 0.1 + noise, before, 0.12 + noise, ["intensity"])
    np.testing.assert_allclose(gap["intensity"].floor, 0.12, atol=0.003)
    assert closure.low > 1
    assert closure.low < closure.value < closure.high
    assert gaps(before, 0.1 + noise, before, 0.2 + 10 * noise, ["intensity"])[1] is None


@pytest.mark.parametrize("grown", [0.0, 0.03])
def test_a_channel_is_not_worse_only_where_the_scenes_show_it(grown):
    before = np.full((5, 3), 0.2)
    after = before * (1 + grown) + np.array([-1, 0, 1, 0, 0])[:, None] * 1e-4
    gap, _ = gaps(before, after, before, before, ["intensity"])
    assert gap["drop"].not_worse is (grown == 0)
    unsure = before + np.array([-1, 0, 1, 0, 0])[:, None] * 0.02
    assert not gaps(before, unsure, before, before, ["intensity"])[0]["drop"].not_worse
