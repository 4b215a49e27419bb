"""LIDIA's training on images of one's own: its loss, one epoch of it, and its weights kept."""

from dataclasses import replace

import jax
import numpy as np
import pytest

from benchmarks.studies import lidia_adaptation
from benchmarks.studies.lidia_adaptation import Adaptation, adapt, adapt_to_itself
from jaxsim.cli import main
from jaxsim.prepare.denoise.lidia import (
    Lidia,
    Variant,
    from_published,
    open_lidia,
    published_shapes,
    save_lidia,
)
from tests.prepare.lidia_oracle import random_state

pytestmark = pytest.mark.long

HEAD = "separable_fc_net.sep_part2.ver_hor_out"
EPOCHS = 24
ONE_EPOCH = Adaptation(noise=0.1, epochs=1, block=16, stride=16, batch=2)


@pytest.fixture(scope="module")
def silent():
    """A network that tells of no noise: it gives images back as they came."""
    state = random_state(published_shapes(Variant(small=True)), seed=0)
    # Of the head's two factors one is left: with both at zero neither would learn.
    for name in (f"{HEAD}.ver.weight", f"{HEAD}.b"):
        state[name] *= 0
    return Lidia(*from_published(state))


@pytest.fixture(scope="module")
def small(samples):
    return Lidia(*from_published(dict(np.load(samples / "weights_lidia/model_state_small_sigma_25_bw.npz"))))


@pytest.fixture
def losses(monkeypatch):
    """Those of every step."""
    seen, step = [], lidia_adaptation._step

    def recorded(*arrays, **settings):
        with jax.numpy_dtype_promotion("standard"):  # optax raises a float to an int
            updated = step(*arrays, **settings)
        seen.append(float(updated[1]))
        return updated

    monkeypatch.setattr(lidia_adaptation, "_step", recorded)
    return seen


def blocks():
    """Two images of 16 x 16, what was measured of them, and noise that differs from cell to cell."""
    rng = np.random.default_rng(0)
    v, u = np.mgrid[:16, :16]
    images = np.stack([0.5 + 0.3 * np.sin(u / 5 + k) * np.cos(v / 4) for k in range(2)]).astype(np.float32)
    return images, rng.random(images.shape) < 0.8, rng.normal(0, 0.1, images.shape).astype(np.float32)


def moved(network, other, part):
    """Which of the arrays of this name differ."""
    leaves = zip(jax.tree.leaves_with_path(network.values), jax.tree.leaves(other.values), strict=True)
    return [not np.array_equal(one, two) for (path, one), two in leaves if path[-1].key == part]


def test_the_loss_of_pairs_is_log10_of_the_mean_square_over_measured_cells(silent, losses):
    images, valid, noise = blocks()
    noisy = np.where(valid, images + noise, np.nan).astype(np.float32)
    clean = np.where(valid, images, np.nan).astype(np.float32)
    taught = adapt(silent, clean, valid, settings=ONE_EPOCH, noisy=noisy)
    # Images are shown on [-1, 1], where noise is twice what it is on 0..1.
    assert losses == pytest.approx([np.log10(((2 * noise[valid]) ** 2).mean())], abs=1e-4)
    assert any(moved(silent, taught, "weight"))
    assert all(moved(silent, taught, "running_mean"))


def test_training_lowers_the_loss_of_the_very_blocks_that_it_began_with(silent, losses):
    images, valid, noise = blocks()
    pair = {"noisy": np.where(valid, images + noise, np.nan).astype(np.float32)}
    clean = np.where(valid, images, np.nan).astype(np.float32)
    taught = adapt(silent, clean, valid, settings=replace(ONE_EPOCH, epochs=EPOCHS), **pair)
    # The first epoch's blocks are the same in every training: one step more tells their loss after it. Losses of
    # different steps are not to be compared: each epoch mirrors its blocks anew, which moves them by 0.01.
    adapt(taught, clean, valid, settings=ONE_EPOCH, **pair)
    before, after = losses[0], losses[EPOCHS]
    assert after < before - 0.005


def test_an_image_stands_for_its_own_clean_one_under_new_noise(silent, losses):
    images, valid, _ = blocks()
    taught = adapt_to_itself(silent, images, valid, settings=ONE_EPOCH)
    # What the network makes of the images is the images: what is left is the noise that was added.
    assert losses == pytest.approx([np.log10((2 * ONE_EPOCH.noise) ** 2)], abs=0.1)
    assert any(moved(silent, taught, "weight"))


def test_a_network_is_kept_and_read_again(silent, tmp_path):
    path = tmp_path / "own.npz"
    save_lidia(path, silent.values)
    kept = open_lidia(path)
    assert kept.variant == silent.variant
    jax.tree.map(np.testing.assert_array_equal, kept.values, silent.values)
    assert [file.name for file in tmp_path.iterdir()] == ["own.npz"]
    # Written anew under its name, it is read anew.
    other = from_published(random_state(published_shapes(Variant(small=True)), seed=1))[1]
    save_lidia(path, other)
    jax.tree.map(np.testing.assert_array_equal, open_lidia(path).values, other)
    main(["convert", "lidia", str(path), "--out", str(tmp_path / "again.npz")])
    jax.tree.map(np.testing.assert_array_equal, open_lidia(tmp_path / "again.npz").values, other)
    with pytest.raises(ValueError, match=r"kept as \.npz, not as own\.pt; name the file own\.npz"):
        save_lidia(tmp_path / "own.pt", other)


@pytest.mark.slow
def test_adapting_to_one_s_own_images_helps_on_others(small):
    v, u = np.mgrid[:16, :48]
    images = np.stack([0.5 + 0.3 * np.sin(u / 7 + k) * np.cos(v / 5) for k in range(6)]).astype(np.float32)
    rng = np.random.default_rng(0)
    valid = rng.random(images.shape) < 0.9
    noisy = (images + 0.1 * rng.standard_normal(images.shape)).astype(np.float32)
    with jax.numpy_dtype_promotion("standard"):  # optax raises a float to an int
        taught = adapt(small, images[:5], valid[:5], settings=Adaptation(noise=0.1, epochs=6, stride=16))
    off = lambda network: ((network(noisy[5], valid[5]) - images[5])[valid[5]] ** 2).mean()  # noqa: E731
    assert off(taught) < 0.8 * off(small)
    # Cells without return take no part.
    garbage = np.where(valid, images, np.nan).astype(np.float32)
    settings = Adaptation(noise=0.1, epochs=1, stride=16)
    with jax.numpy_dtype_promotion("standard"):
        one, other = (adapt(small, x[:2], valid[:2], settings=settings) for x in (images, garbage))
    np.testing.assert_array_equal(other(noisy[5], valid[5]), one(noisy[5], valid[5]))


def test_adapting_to_nothing_says_so(small):
    with pytest.raises(ValueError, match="nothing to adapt to"):
        adapt(small, np.ones((1, 16, 16), np.float32), np.zeros((1, 16, 16), bool))
    with pytest.raises(ValueError, match="at least 11 x 11"):
        adapt(small, np.ones((1, 8, 16), np.float32), np.ones((1, 8, 16), bool))
