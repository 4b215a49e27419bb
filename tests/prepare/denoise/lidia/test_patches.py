"""LIDIA's handling of cells without return, against loops over cells."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim.native import build
from jaxsim.prepare.denoise.lidia import denoiser as whole
from jaxsim.prepare.denoise.lidia.patches import NEIGHBOURS, RADIUS, UNLIKE, fold, nearest_patches, patch_counts, unfold

SHAPE = (12, 13)
GARBAGE = 1e3


def measured_image(d):
    """Random cells with the margin of the search around them; two thirds measured, but for one corner."""
    rng = np.random.default_rng(d)
    size = [side + 2 * RADIUS * d for side in SHAPE]
    measured = rng.random(size) < 0.65
    corner = slice(RADIUS * d, RADIUS * d + 10)
    measured[corner, corner] &= rng.random((10, 10)) < 0.08
    return rng.uniform(-1, 1, size).astype(np.float32), measured


def likeness(image, measured, here, there, p, d):
    """Sum of squared differences over the cells that both patches measured, scaled to a whole patch."""
    total, shared = 0.0, 0
    for i in range(0, d * p, d):
        for j in range(0, d * p, d):
            one, other = (here[0] + i, here[1] + j), (there[0] + i, there[1] + j)
            if measured[one] and measured[other]:
                total += (float(image[one]) - float(image[other])) ** 2
                shared += 1
    return total * p * p / shared if shared >= p else UNLIKE


@pytest.mark.parametrize(("p", "d"), [(7, 1), (5, 2)])
def test_patches_are_alike_by_the_cells_that_both_measured(p, d):
    image, measured = measured_image(d)
    dirty = np.where(measured, image, GARBAGE).astype(np.float32)
    found, index = (np.asarray(x) for x in nearest_patches(dirty, measured, p=p, d=d))
    rows, columns = (side - d * (p - 1) for side in SHAPE)
    assert found.shape == index.shape == (rows, columns, NEIGHBOURS)
    wide = image.shape[1] - d * (p - 1)
    lost = 0
    for row in range(rows):
        for column in range(columns):
            here = (row + RADIUS * d, column + RADIUS * d)
            shifts = range(0, 2 * RADIUS * d + 1, d)
            places = [(row + i, column + j) for i in shifts for j in shifts if (row + i, column + j) != here]
            expected = {place: likeness(image, measured, here, place, p, d) for place in places}
            nearest = sorted(expected.values())[: NEIGHBOURS - 1]
            np.testing.assert_allclose(found[row, column], [0.0, *nearest], rtol=1e-5, atol=1e-6)
            chosen = [divmod(int(number), wide) for number in index[row, column]]
            assert chosen[0] == here
            assert len(set(chosen)) == NEIGHBOURS
            # The numbers are those of patches at these distances: all of them, where nothing is known of any.
            np.testing.assert_allclose([expected[place] for place in chosen[1:]], nearest, rtol=1e-5, atol=1e-6)
            lost += nearest[0] == UNLIKE
    assert 0 < lost < rows * columns


def test_mean_coarse_image_and_variance_are_of_measured_cells():
    rng = np.random.default_rng(0)
    image = rng.uniform(-1, 1, (1, *SHAPE, 1)).astype(np.float32)
    measured = rng.random((1, *SHAPE)) < 0.5
    measured[0, :5, :5] = False
    dirty = np.where(measured[..., None], image, np.float32(GARBAGE))
    mask = jnp.asarray(measured[..., None], jnp.float32)
    cells, known = image[0, ..., 0].astype(np.float64), measured[0]
    np.testing.assert_allclose(np.asarray(whole._mean(dirty, measured)).item(), cells[known].mean(), rtol=1e-5)

    coarse, seen = (np.asarray(x)[0, ..., 0] for x in whole._blurred(jnp.asarray(dirty), mask))
    kernel = np.outer([1, 2, 1], [1, 2, 1]) / 16
    for row in range(SHAPE[0] - 2):
        for column in range(SHAPE[1] - 2):
            view = np.s_[row : row + 3, column : column + 3]
            weight = kernel * known[view]
            assert seen[row, column] == known[view].any()
            if known[view].any():
                mean = (weight * cells[view]).sum() / weight.sum()
                np.testing.assert_allclose(coarse[row, column], mean, rtol=1e-5, atol=1e-6)
    assert 0 < (seen == 0).sum() < seen.size

    p, d = 5, 2
    patches, masks = (whole.unfold(jnp.asarray(x), p, d) for x in (dirty, mask))
    own = np.asarray(whole._variance(patches, masks))[0, ..., 0]
    few = 0
    for row in range(own.shape[0]):
        for column in range(own.shape[1]):
            view = np.s_[row : row + d * p : d, column : column + d * p : d]
            there = cells[view][known[view]]
            if len(there) > 1:
                np.testing.assert_allclose(own[row, column], p * p * there.var(ddof=1), rtol=1e-5)
            few += len(there) < p * p
    assert few


def test_folding_is_the_adjoint_of_unfolding():
    rng = np.random.default_rng(0)
    image = rng.standard_normal((2, 15, 17, 3)).astype(np.float32)
    for p, d in ((7, 1), (5, 2)):
        apart = np.asarray(unfold(image, p, d))
        patches = rng.standard_normal(apart.shape).astype(np.float32)
        back = jax.jit(fold, static_argnums=(1, 2))
        assert float((image * np.asarray(back(patches, p, d))).sum()) == pytest.approx(
            (apart * patches).sum(), rel=1e-4
        )
        again = back(apart, p, d) / patch_counts(*apart.shape[1:3], p, d=d)
        np.testing.assert_allclose(np.asarray(again), image, rtol=1e-5, atol=1e-6)


def in_both_forms(monkeypatch, image, measured, p, d):
    """Distances and numbers of the C++ form, and of XLA's."""
    answers = []
    for setting in ("1", "0"):
        monkeypatch.setenv(build.SETTING, setting)
        program = jax.jit(lambda *given: nearest_patches.__wrapped__(*given, p=p, d=d))
        lowered = program.lower(image, measured)
        assert ("@jaxsim_nearest_patches" in lowered.as_text()) == (setting == "1")
        answers.append(jax.device_get(lowered.compile()(image, measured)))
    return answers


@pytest.mark.skipif(not build.available(), reason="no C++ form here")
@pytest.mark.parametrize(("p", "d"), [(7, 1), (7, 2), (5, 1), (5, 2)])
@pytest.mark.parametrize("masked", [False, True])
def test_the_search_in_cpp_is_xlas(p, d, masked, monkeypatch):
    """Rounded cells: many patches are as near as others, and the first of them counts."""
    image, measured = measured_image(d)
    image = np.round(2 * image) / 2
    for mine, xlas in zip(*in_both_forms(monkeypatch, image, measured if masked else None, p, d), strict=True):
        np.testing.assert_array_equal(mine, xlas)


@pytest.mark.skipif(not build.available(), reason="no C++ form here")
def test_widths_that_no_network_has_are_refused():
    image, _ = measured_image(1)
    with pytest.raises(Exception, match="5 or 7 cells wide"):
        jax.block_until_ready(nearest_patches(jnp.asarray(image), None, p=3, d=1))
