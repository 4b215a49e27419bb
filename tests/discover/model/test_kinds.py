"""What stands in for classes where there are none."""

from dataclasses import replace

import jax
import numpy as np
import pytest

from jaxsim.discover.model.evidence import gather
from jaxsim.discover.model.kinds import few_levels, kinds_of
from jaxsim.discover.model.null_model import fit_null
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
    of_height = np.array([name.endswith(" m") for name in names])
    np.testing.assert_allclose(share[..., ~of_height].sum(-1), 1, atol=1e-6)
    standing = share[..., of_height].sum(-1)
    assert 0.2 < standing.mean() < 0.8
    np.testing.assert_allclose(standing[standing > 0], 1, atol=1e-6)
    ground = share[..., [name.startswith("ground") for name in names]].sum(-1)
    # Rays that look almost level are of neither.
    clear = np.abs(np.asarray(scan.grid.elevation_rad)) > 0.03
    road = np.asarray(scan.semantic)[INDEX] == 7
    assert (ground == road)[:, :, clear].mean() > 0.99


def test_few_intensities_are_a_table_and_steps_of_a_rounding_are_not():
    rng = np.random.default_rng(0)
    table = np.array([55, 67, 127, 255]) / 255
    angle = rng.uniform(0, 1.5, 5000)
    np.testing.assert_allclose(few_levels(rng.choice(table, 5000), angle), table, atol=1e-5)
    assert few_levels(rng.uniform(0, 1, 5000), angle) is None
    # A dark scene in 8 bits has few values, too; so has a road of Lambert's law, one a row.
    assert few_levels(rng.integers(1, 30, 5000) / 255, angle) is None
    rows = rng.choice(np.linspace(0.6, 1.5, 12), 5000)
    assert few_levels(0.3 * np.cos(rows), rows) is None
    assert few_levels(np.zeros(0), np.zeros(0)) is None
    assert len(few_levels(np.full(50, 0.4), angle[:50])) == 1


@pytest.mark.parametrize("labelled", [True, False])
def test_each_intensity_of_a_table_is_a_kind_of_its_class(frames, labelled):
    scan, _ = frames
    road = np.asarray(scan.semantic) == 7
    bay = np.arange(60) < 20
    flat = np.where(road, 0.2, np.where(bay, 0.3, 0.7)).astype(np.float32)
    scan = scan if labelled else unlabelled(scan)
    tilted = np.random.default_rng(2).uniform(0, 1.5, flat.shape).astype(np.float32)
    names, share = kinds_of(replace(scan, intensity=flat, incidence_rad=tilted), INDEX)
    np.testing.assert_allclose(share.sum(-1), 1)
    assert {name.rpartition(" ")[2] for name in names} == {"0.2", "0.3", "0.7"}
    of_bay = share[..., [name.endswith(" 0.3") for name in names]].sum(-1)
    np.testing.assert_array_equal(of_bay, (flat == np.float32(0.3))[INDEX])
    if labelled:
        assert names == ("class 7 of intensity 0.2", "class 11 of intensity 0.3", "class 11 of intensity 0.7")


def test_a_table_that_is_wrong_is_no_law_of_intensities(frames):
    """As of a simulator without angles and classes: what its materials really are bends like a response."""
    scan, measured = frames
    road = np.asarray(scan.semantic) == 7
    bay = np.arange(60) < 20
    table = np.where(road, 0.2, np.where(bay, 0.3, 0.7)).astype(np.float32)
    true = np.where(road, 0.24, np.where(bay, 0.3, 0.45))
    rng = np.random.default_rng(1)
    read = np.where(measured.valid, true * np.exp(rng.normal(0, 0.08, true.shape)), 0).astype(np.float32)
    tilted = rng.uniform(0, 1.3, true.shape).astype(np.float32)
    flat = replace(unlabelled(scan), intensity=table, incidence_rad=tilted)
    ev = gather(*device(flat, replace(measured, intensity=read)), frame=FRAMES, column=COLUMNS, scene=FRAMES)
    with jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"):
        null = fit_null(device(flat)[0], ev)
        ranks = rank_effects(null, [get_effect(n) for n in ("gamma_response", "saturation", "intensity_offset")])
    assert [one.effect.name for one in ranks if one.accepted()] == []


def accepted(scan, measured, *names):
    """Those effects that are accepted where the frames tell no classes."""
    ev = gather(*device(unlabelled(scan), measured), frame=FRAMES, column=COLUMNS, scene=FRAMES)
    with jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"):
        null = fit_null(device(scan)[0], ev)
        return [one.effect.name for one in rank_effects(null, [get_effect(n) for n in names]) if one.accepted()]


def dimmed(measured, where, factor):
    """The readings with those of some rays multiplied."""
    return replace(measured, intensity=np.where(where, factor * measured.intensity, measured.intensity).astype("f4"))


def test_a_floor_darker_than_its_table_is_no_effect_where_no_class_tells_it(frames):
    scan, measured = frames
    darker = dimmed(measured, np.asarray(scan.semantic) == 7, 0.8)
    assert accepted(scan, darker, "gamma_response", "incidence_cosine", "beam_gain") == []


def test_walls_whose_lower_part_is_of_another_material_are_no_effect_where_no_class_tells_it(frames):
    scan, measured = frames
    height_m = scan.range_m * np.sin(np.asarray(scan.grid.elevation_rad))[:, None]
    darker = dimmed(measured, (np.asarray(scan.semantic) == 11) & (height_m < -0.6), 0.7)
    assert accepted(scan, darker, "beam_gain", "focal_compensation", "range_falloff") == []
