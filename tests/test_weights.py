"""Published weights to files of our own, and what is said of wrong ones."""

import argparse
import hashlib

import numpy as np
import pytest

from jaxsim.prepare.depth.penet import CONVERTERS as PENET
from jaxsim.weights import (
    Converter,
    checked_arrays,
    convert,
    fingerprint,
    kernel_of,
    load_weights,
    published_shape,
    read_state_dict,
    weights_kind,
    write_trained,
)

SHAPES = {"stem.weight": (4, 3, 3, 3), "stem.bias": (4,)}
TINY = Converter(
    "the tiny network of nobody", "https://example.org/tiny.pth", lambda arrays: checked_arrays(arrays, SHAPES)
)


def state(**more: np.ndarray) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(0)
    return {name: rng.standard_normal(shape).astype(np.float32) for name, shape in SHAPES.items()} | more


def test_what_was_converted_comes_back_under_its_published_names(tmp_path):
    arrays = state()
    np.savez(tmp_path / "state.npz", **arrays, extra=np.zeros(3))
    written = convert("tiny", TINY, tmp_path / "state.npz", out=tmp_path / "out.npz")
    kept = load_weights(tmp_path / "out.npz", "tiny", TINY)
    assert sorted(kept.arrays) == sorted(SHAPES)
    for name, array in kept.arrays.items():
        np.testing.assert_array_equal(array, arrays[name])
    assert kept.sha256 == written.sha256 == fingerprint(arrays)
    assert weights_kind(tmp_path / "out.npz") == "tiny"
    assert weights_kind(tmp_path / "state.npz") is None
    assert not kept.published


def test_only_the_very_file_of_the_publisher_counts_as_published(tmp_path):
    source = tmp_path / "state.npz"
    np.savez(source, **state())
    digest = hashlib.sha256(source.read_bytes()).hexdigest()
    for known, published in ((digest[:8], True), ("0" * 8, False)):
        named = Converter(TINY.title, TINY.fetch, TINY.convert, digest=known)
        convert("tiny", named, source, out=tmp_path / "out.npz")
        assert load_weights(tmp_path / "out.npz", "tiny", named).published is published


def test_a_shared_prefix_falls_away():
    wrapped = {f"module.{name}": array for name, array in state().items()}
    assert sorted(checked_arrays(wrapped, SHAPES)) == sorted(SHAPES)


def test_weights_of_another_network_are_refused_by_name_and_shape(tmp_path):
    np.savez(tmp_path / "other.npz", **{"stem.weight": np.zeros((8, 3, 3, 3)), "head.weight": np.zeros(2)})
    with pytest.raises(ValueError, match=r"is not the tiny network of nobody") as raised:
        convert("tiny", TINY, tmp_path / "other.npz", out=tmp_path / "out.npz")
    message = str(raised.value)
    assert "stem.weight is (8, 3, 3, 3), not (4, 3, 3, 3)" in message
    assert "stem.bias is missing, not (4,)" in message
    assert "head.weight" in message
    assert "fetch https://example.org/tiny.pth" in message
    assert not (tmp_path / "out.npz").exists()


def test_a_file_of_another_kind_or_of_no_kind_is_refused(tmp_path):
    np.savez(tmp_path / "plain.npz", **state())
    with pytest.raises(ValueError, match=r"was not written by `jaxsim convert`.*jaxsim convert tiny FILE"):
        load_weights(tmp_path / "plain.npz", "tiny", TINY)
    convert("other", TINY, tmp_path / "plain.npz", out=tmp_path / "other.npz")
    with pytest.raises(ValueError, match="holds other, not tiny"):
        load_weights(tmp_path / "other.npz", "tiny", TINY)
    with pytest.raises(FileNotFoundError, match="no the tiny network"):
        load_weights(tmp_path / "none.npz", "tiny", TINY)


def test_damaged_files_say_so(tmp_path):
    path = tmp_path / "broken.npz"
    path.write_bytes(b"PK nonsense")
    with pytest.raises(ValueError, match=r"no readable \.npz"):
        read_state_dict(path)
    assert weights_kind(path) is None
    np.savez(path, about=np.array("{not json"))
    assert weights_kind(path) is None


def test_state_dicts_published_as_a_folder_are_read_together(tmp_path):
    for name in ("backbone.npz", "head.npz"):
        np.savez(tmp_path / name, w=np.ones(2))
    assert sorted(read_state_dict(tmp_path, ("backbone.npz", "head.npz"))) == ["backbone.npz.w", "head.npz.w"]
    with pytest.raises(FileNotFoundError, match=r"decoder\.npz is missing"):
        read_state_dict(tmp_path, ("backbone.npz", "decoder.npz"))


def test_pytorch_files_are_read_as_plain_tensors_alone(tmp_path):
    torch = pytest.importorskip("torch")
    arrays = state()
    nested = {"state_dict": {name: torch.from_numpy(a) for name, a in arrays.items()}, "epoch": 3}
    torch.save(nested, tmp_path / "state.pth")
    kept = convert("tiny", TINY, tmp_path / "state.pth", out=tmp_path / "out.npz").arrays
    np.testing.assert_array_equal(kept["stem.weight"], arrays["stem.weight"])
    torch.save({"a": Converter}, tmp_path / "code.pth")
    with pytest.raises(ValueError, match="no PyTorch checkpoint of plain tensors"):
        read_state_dict(tmp_path / "code.pth")


def test_a_checkpoint_that_holds_more_than_tensors_says_what_to_do(tmp_path):
    """As PENet's, which holds the settings of its training."""
    torch = pytest.importorskip("torch")
    content = {"model": {"stem.bias": torch.zeros(4)}, "args": argparse.Namespace(lr=1e-3)}
    torch.save(content, tmp_path / "pe.pth.tar")
    with pytest.raises(ValueError, match=r"^convert: .*pe\.pth\.tar cannot be read as PENet") as raised:
        convert("penet", PENET["penet"], tmp_path / "pe.pth.tar", out=tmp_path / "out.npz")
    message = str(raised.value)
    assert "weights_only=False" in message
    assert "only if you trust the file" in message
    assert "argparse.Namespace was not an allowed global" in message
    assert not (tmp_path / "out.npz").exists()


def test_a_file_that_is_no_archive_says_what_to_fetch(tmp_path):
    (tmp_path / "state.npz").write_bytes(b"PK nonsense")
    with pytest.raises(
        ValueError, match=r"cannot be read as the tiny network of nobody: .*; fetch https://example\.org"
    ):
        convert("tiny", TINY, tmp_path / "state.npz", out=tmp_path / "out.npz")


def test_a_network_that_was_trained_here_says_so(tmp_path):
    write_trained(tmp_path / "own.npz", "tiny", {name: np.zeros(shape, np.float32) for name, shape in SHAPES.items()})
    assert weights_kind(tmp_path / "own.npz") == "tiny"
    assert not load_weights(tmp_path / "own.npz", "tiny", TINY).published


def test_kernels_of_pytorch_are_taken_over_with_their_taps():
    array = np.arange(5 * 4 * 3 * 2, dtype=np.float32).reshape(5, 4, 3, 2)
    kernel, turned = kernel_of(array), kernel_of(array, transposed=True)
    assert kernel[2, 1, 3, 4] == array[4, 3, 2, 1]
    assert turned[2, 1, 4, 3] == array[4, 3, 0, 0]
    assert published_shape(kernel.shape) == published_shape(turned.shape, transposed=True) == array.shape
    assert published_shape((7,)) == (7,)
