"""LIDIA behind `denoise`: cells without return, weights, and what is said of bad input."""

from dataclasses import replace

import numpy as np
import pytest

from jaxsim.cli import main
from jaxsim.config import DataConfig, PrepareConfig
from jaxsim.pairs.prepared import pairs_folder
from jaxsim.prepare import denoise
from jaxsim.prepare.denoise.lidia import Lidia, Variant, from_published, open_lidia, published_shapes
from tests.prepare.lidia_oracle import random_state


@pytest.fixture(scope="module")
def small(samples):
    return Lidia(*from_published(dict(np.load(samples / "weights_lidia/model_state_small_sigma_25_bw.npz"))))


@pytest.fixture(scope="module")
def published(samples, tmp_path_factory):
    out = tmp_path_factory.mktemp("lidia") / "lidia.npz"
    main(["convert", "lidia", str(samples / "weights_lidia/model_state_small_sigma_25_bw.npz"), "--out", str(out)])
    return out


def scene(noise=0.08, shape=(24, 40)):
    rng = np.random.default_rng(0)
    clean = np.where(np.arange(shape[1]) < shape[1] // 2, 0.3, 0.6) * np.ones(shape)
    return clean, (clean + noise * rng.normal(size=shape)).clip(0, 1).astype(np.float32)


@pytest.mark.parametrize("statistics", ["stored", "image"])
def test_what_stands_in_cells_without_return_changes_nothing(small, statistics):
    _, noisy = scene()
    valid = np.random.default_rng(2).random(noisy.shape) < 0.6
    outputs = [
        small(np.where(valid, noisy, filling).astype(np.float32), valid, statistics=statistics)
        for filling in (0.0, 1.0, np.nan, np.random.default_rng(3).random(noisy.shape))
    ]
    for other in outputs[1:]:
        np.testing.assert_array_equal(other, outputs[0])
    assert not outputs[0][~valid].any()


def test_cells_without_return_are_no_black_ones(small):
    clean, noisy = scene()
    valid = np.random.default_rng(2).random(noisy.shape) < 0.6
    smooth = small(noisy, valid)
    black = small(np.where(valid, noisy, 0).astype(np.float32), np.ones_like(valid))
    off = lambda x: np.abs(x - clean)[valid].mean()  # noqa: E731
    assert off(smooth) < 0.5 * off(noisy)
    assert off(smooth) < 0.2 * off(black)


def test_a_mask_that_lets_all_pass_is_none(small):
    _, noisy = scene()
    without = small(noisy, np.ones(noisy.shape, bool), statistics="stored")
    valid = np.ones(noisy.shape, bool)
    valid[0, 0] = False
    # One corner less: what lies beyond its patches' neighbours is what it was.
    np.testing.assert_allclose(small(noisy, valid, statistics="stored")[:, 20:], without[:, 20:], atol=2e-3)


def test_a_gain_brings_weak_noise_to_what_the_network_was_trained_for(small):
    clean, noisy = scene(noise=0.03)
    valid = np.random.default_rng(2).random(noisy.shape) < 0.6
    off = lambda x: ((x - clean)[valid] ** 2).mean()  # noqa: E731
    assert off(small(noisy, valid, gain=3.0)) < 0.8 * off(noisy)


def test_a_batch_is_its_images(small):
    _, noisy = scene()
    valid = np.random.default_rng(5).random((3, *noisy.shape)) < 0.8
    images = np.stack([noisy, noisy[::-1], noisy[:, ::-1]])
    batch = small(images, valid)
    np.testing.assert_array_equal(batch[1], small(images[1], valid[1]))
    assert batch.shape == images.shape


def test_denoise_reads_what_convert_writes(published, small):
    _, noisy = scene()
    valid = np.random.default_rng(2).random(noisy.shape) < 0.6
    np.testing.assert_array_equal(denoise(noisy, valid, "lidia", weights=published), small(noisy, valid))
    assert open_lidia(published).variant == Variant(small=True)


def test_pairs_made_with_other_weights_are_not_kept_together(published, tmp_path):
    data, config = DataConfig(), PrepareConfig(denoise="lidia", denoise_weights=published)
    other = tmp_path / published.name
    other.write_bytes(published.read_bytes())
    assert pairs_folder(data, config) != pairs_folder(data, replace(config, denoise_statistics="stored"))
    before = pairs_folder(data, replace(config, denoise_weights=other))
    np.savez(other, changed=np.ones(1))
    assert pairs_folder(data, replace(config, denoise_weights=other)) != before
    with pytest.raises(FileNotFoundError, match="no weights at"):
        pairs_folder(data, replace(config, denoise_weights=tmp_path / "none.npz"))


def test_a_training_checkpoint_is_converted_without_its_optimiser(tmp_path, capsys):
    state = random_state(published_shapes(Variant(colour=True)), seed=0)
    wrapped = {f"state_dict.{name}": array for name, array in state.items()}
    extra = {"state_dict.weights_net0.bn0.num_batches_tracked": np.array(3), "optimizer.state.0.exp_avg": np.ones(2)}
    np.savez(tmp_path / "state.npz", **wrapped, **extra)
    main(["convert", "lidia", str(tmp_path / "state.npz"), "--out", str(tmp_path / "out.npz")])
    assert f"{len(state)} arrays of LIDIA" in capsys.readouterr().out
    assert open_lidia(tmp_path / "out.npz").variant == Variant(colour=True)
    with pytest.raises(ValueError, match=r"for colour images; intensity is grey: convert a \*_bw\.pt file"):
        open_lidia(tmp_path / "out.npz")(np.ones((20, 20), np.float32), np.ones((20, 20), bool))


def test_weights_of_another_network_are_refused(tmp_path):
    path, out = tmp_path / "state.npz", str(tmp_path / "out.npz")
    state = random_state(published_shapes(Variant()), seed=0)
    np.savez(path, **{"conv1.weight": np.ones((3, 3))})
    with pytest.raises(SystemExit, match="is not LIDIA: it is no LIDIA network"):
        main(["convert", "lidia", str(path), "--out", out])
    np.savez(path, **{**state, "separable_fc_net.sep_part2.a": np.ones(2, np.float32)})
    with pytest.raises(SystemExit, match=r"separable_fc_net\.sep_part2\.a is \(2,\), not \(1,\)"):
        main(["convert", "lidia", str(path), "--out", out])
    first = "separable_fc_net.sep_part1_s0.ver_hor_bn_re0.ver_hor.ver.weight"
    np.savez(path, **{**state, first: np.ones((64, 25), np.float32)})
    with pytest.raises(SystemExit, match=r"is \(64, 25\); it is \(64, 49\) in a grey network"):
        main(["convert", "lidia", str(path), "--out", out])


def test_bad_input_says_what_to_do(small, tmp_path):
    image, valid = np.ones((20, 20), np.float32), np.ones((20, 20), bool)
    with pytest.raises(ValueError, match=r"lidia needs its weights.*--prepare\.denoise-weights"):
        denoise(image, valid, "lidia")
    with pytest.raises(FileNotFoundError, match="jaxsim convert lidia FILE"):
        denoise(image, valid, "lidia", weights=tmp_path / "none.npz")
    with pytest.raises(ValueError, match=r"a gain of 0\.0 leaves nothing"):
        small(image, valid, gain=0.0)
    with pytest.raises(ValueError, match="not one cell whose beam came back"):
        small(image, ~valid)
    with pytest.raises(ValueError, match=r"the image has 8 x 20 cells.*at least 11 x 11"):
        small(image[:8], valid[:8])
