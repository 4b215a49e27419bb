"""RangeNet++ beside a slow program in NumPy, on a narrow network of the published names."""

import numpy as np
import pytest

from jaxsim.metrics.rangenet import (
    CONVERTER,
    DEVIATIONS,
    MEANS,
    _chosen,
    decoder_map,
    fold_batch_norm,
    load_rangenet,
    network_image,
    published_shapes,
)

WIDTH, BLOCKS = 2, (1, 2, 1, 1, 1)


def drawn(seed: int) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(seed)
    arrays = {}
    for name, shape in published_shapes(WIDTH, BLOCKS).items():
        x = rng.standard_normal(shape)
        if len(shape) == 4:
            x = x * np.sqrt(2 / np.prod(shape[1:]))
        elif name.endswith("running_var"):
            x = 0.5 + np.abs(x)
        elif name.endswith("weight"):
            x = 1 + 0.1 * x
        arrays[name] = x.astype(np.float32)
    return arrays


def leaky(x):
    return np.where(x > 0, x, 0.1 * x)


def norm(arrays, name, x):
    """Channels first."""
    weight, bias, mean, variance = (
        arrays[f"{name}.{p}"][:, None, None].astype(float) for p in ("weight", "bias", "running_mean", "running_var")
    )
    return (x - mean) / np.sqrt(variance + 1e-5) * weight + bias


def convolve(x, weight, *, stride=1):
    """PyTorch's Conv2d with half the kernel of padding; stride along columns alone."""
    half = weight.shape[2] // 2
    padded = np.pad(x, ((0, 0), (half, half), (half, half)))
    windows = np.lib.stride_tricks.sliding_window_view(padded, weight.shape[2:], (1, 2))
    return np.einsum("chwij,ocij->ohw", windows, weight.astype(float))[:, :, ::stride]


def upconvolve(x, weight, bias):
    """PyTorch's ConvTranspose2d, kernel (1, 4), stride (1, 2), padding (0, 1): each cell adds to four new ones."""
    _, h, w = x.shape
    wide = np.zeros((weight.shape[1], h, 2 * w + 2))
    for column in range(w):
        for tap in range(4):
            wide[:, :, 2 * column + tap] += np.einsum("ch,co->oh", x[:, :, column], weight[:, :, 0, tap].astype(float))
    return wide[:, :, 1:-1] + bias[:, None, None]


def slow(arrays, image):
    def residual(name, x):
        inner = leaky(norm(arrays, f"{name}.bn1", convolve(x, arrays[f"{name}.conv1.weight"])))
        return x + leaky(norm(arrays, f"{name}.bn2", convolve(inner, arrays[f"{name}.conv2.weight"])))

    x = leaky(norm(arrays, "backbone.bn1", convolve(image, arrays["backbone.conv1.weight"])))
    skips = []
    for i, count in enumerate(BLOCKS):
        stage = f"backbone.enc{i + 1}"
        skips.append(x)
        x = leaky(norm(arrays, f"{stage}.bn", convolve(x, arrays[f"{stage}.conv.weight"], stride=2)))
        for k in range(count):
            x = residual(f"{stage}.residual_{k}", x)
    for i in range(5, 0, -1):
        stage = f"segmentation_decoder.dec{i}"
        up = upconvolve(x, arrays[f"{stage}.upconv.weight"], arrays[f"{stage}.upconv.bias"])
        x = residual(f"{stage}.residual", leaky(norm(arrays, f"{stage}.bn", up))) + skips[i - 1]
    return x


def test_the_decoder_s_map_equals_the_slow_program_s():
    arrays = drawn(0)
    image = np.random.default_rng(1).standard_normal((1, 4, 64, 5)).astype(np.float32)
    got = np.asarray(decoder_map(fold_batch_norm(arrays, WIDTH, BLOCKS), image, blocks=BLOCKS))
    want = slow(arrays, image[0].transpose(2, 0, 1).astype(float))
    assert np.abs(want).max() > 0.1
    np.testing.assert_allclose(got[0].transpose(2, 0, 1), want, rtol=1e-3, atol=1e-4 * np.abs(want).max())


def test_names_and_shapes_are_those_of_the_published_files():
    shapes = published_shapes()
    assert shapes["backbone.conv1.weight"] == (32, 5, 3, 3)
    assert shapes["backbone.enc3.residual_7.conv2.weight"] == (256, 128, 3, 3)
    assert shapes["backbone.enc5.bn.running_var"] == (1024,)
    assert shapes["segmentation_decoder.dec5.upconv.weight"] == (1024, 512, 1, 4)
    assert shapes["segmentation_decoder.dec1.residual.conv1.weight"] == (64, 32, 1, 1)
    # Darknet-53 has 52 convolutions before its classifier; the decoder three a stage.
    assert sum(len(shape) == 4 for shape in shapes.values()) == 52 + 15


def test_images_hold_the_nearest_point_standardised_and_nothing_elsewhere():
    xyz = np.array([[[10, 0, 0], [20, 0, 0], [0, 5, -1], [1, 1, 1]]], np.float32)
    remission = np.array([[0.5, 0.9, 0.1, 0.2]], np.float32)
    got = np.asarray(network_image(xyz, remission, np.array([[True, True, True, False]])))
    assert got.shape == (1, 64, 1024, 5)
    filled = np.argwhere((got != 0).any(-1))
    assert len(filled) == 2
    # Straight ahead lies in the middle, 5 m to the left a quarter turn before it.
    assert {int(column) for _, _, column in filled} == {512, 256}
    near = got[tuple(filled[filled[:, 2] == 512][0])] * DEVIATIONS + MEANS
    np.testing.assert_allclose(near, [10, 10, 0, 0, 0.5], atol=1e-5)


def test_the_features_are_always_the_same_4096_places():
    row, column, channel = _chosen()
    assert len({*zip(row.tolist(), column.tolist(), channel.tolist(), strict=True)}) == 4096
    # The first that Python gives for random.seed(0); random.sample(range(2097152), 4096).
    assert (channel[0], row[0], column[0]) == np.unravel_index(1615835, (32, 64, 1024))


def test_missing_weights_say_what_to_fetch(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"darknet53-1024\.tar\.gz.*jaxsim convert rangenet53 FILE"):
        load_rangenet(tmp_path / "none.npz")
    with pytest.raises(ValueError, match=r"backbone\.conv1\.weight is missing"):
        CONVERTER.convert({})
