"""What stands in for classes where there are none."""

from dataclasses import replace

import jax
import numpy as np
import pytest

from jaxsim.discover.model.evidence import gather, kinds_of
from jaxsim.discover.model.null import fit_null
from jaxsim.discover.name.candidates import rank_effects
from jaxsim.effects import get_effect
from tests.discover.toy import device, toy

FRAMES = np.arange(9)
COLUMNS = np.broadcast_to(np.arange(0, 60, 2), (9, 30))
INDEX = tuple(np.broadcast_arrays(FRAMES[:, None, None], np.arange(16)[None, None], COLUMNS[:, :, None]))


@pytest.fixture(scope="module")
def frames():
    return toy(frames=9)


def unlabelled(scan):
    return replace(scan, semantic=np.zeros_like(scan.semantic))


def test_classes_are_the_kinds_where_there_are_any(frames):
    scan, _ = frames
    names, share = kinds_of(scan, INDEX)
    assert names == ("class 7", "class 11")
    np.testing.assert_array_equal(share[..., 0], np.asarray(scan.semantic)[INDEX] == 7)


def test_without_classes_ground_is_told_from_walls_and_both_by_albedo(frames):
    scan, _ = frames
    names, share = kinds_of(unlabelled(scan), INDEX)
    np.testing.assert_allclose(share.sum(-1), 1, atol=1e-6)
    ground = share[..., [name.startswith("ground") for name in names]].sum(-1)
    # Rays that look almost level are of neither.
    clear = np.abs(np.asarray(scan.grid.elevation_rad)) > 0.03
    road = np.asarray(scan.semantic)[INDEX] == 7
    assert (ground == road)[:, :, clear].mean() > 0.99


def test_a_floor_darker_than_its_table_is_no_effect_where_no_class_tells_it(frames):
    scan, measured = frames
    road = np.asarray(scan.semantic) == 7
    darker = replace(measured, intensity=np.where(road, 0.8 * measured.intensity, measured.intensity).astype("f4"))
    ev = gather(*device(unlabelled(scan), darker), frame=FRAMES, column=COLUMNS, scene=FRAMES)
    with jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"):
        null, _ = fit_null(device(scan)[0], ev, np.ones(9, np.float32))
        ranks = rank_effects(null, [get_effect(n) for n in ("gamma_response", "incidence_cosine", "beam_gain")])
    assert [one.effect.name for one in ranks if one.accepted()] == []
