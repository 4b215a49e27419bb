"""`jaxsim convert` on state dicts of the published names and shapes."""

import subprocess
import sys

import numpy as np
import pytest

from jaxsim.cli import main
from jaxsim.cli.convert import CONVERTERS
from jaxsim.files.whole import HOST, SALT
from jaxsim.pix2pix.losses import VGG_BLOCKS, load_vgg
from jaxsim.prepare.depth import penet
from jaxsim.prepare.depth.penet import open_penet
from jaxsim.prepare.depth.penet.published import STEM, published_shapes


@pytest.fixture
def vgg(tmp_path):
    """torchvision's names; values that tell the places apart."""
    arrays, channels = {"classifier.6.bias": np.zeros(1000, np.float32)}, 3
    for block, places in enumerate(VGG_BLOCKS):
        width = min(64 * 2**block, 512)
        for place in places:
            arrays[f"features.{place}.weight"] = np.full((width, channels, 3, 3), place, np.float32)
            arrays[f"features.{place}.bias"] = np.full(width, -place, np.float32)
            channels = width
    np.savez(tmp_path / "vgg.npz", **arrays)
    return tmp_path / "vgg.npz"


def test_the_perceptual_loss_reads_what_convert_writes(vgg, tmp_path, capsys):
    main(["convert", "vgg19", str(vgg), "--out", str(tmp_path / "out.npz")])
    said = capsys.readouterr().out
    assert "26 arrays of VGG-19 of torchvision" in said
    assert "is not the published file, whose SHA-256 begins with dcbb9e9d" in said
    weights = load_vgg(tmp_path / "out.npz")
    assert weights["features.28.weight"].shape == (3, 3, 512, 512)
    assert weights["features.28.bias"][0] == -28


def test_what_a_killed_command_left_half_written_goes(vgg, tmp_path):
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    (tmp_path / f".jaxsim-{HOST}-{ended.pid}-{SALT}.out.npz").write_bytes(b"half")
    main(["convert", "vgg19", str(vgg), "--out", str(tmp_path / "out.npz")])
    assert {path.name for path in tmp_path.iterdir()} == {"vgg.npz", "out.npz"}


def test_what_is_read_is_not_overwritten(vgg, tmp_path):
    before = vgg.read_bytes()
    (tmp_path / "link.npz").symlink_to(vgg)
    for out in (vgg, tmp_path / "link.npz"):
        with pytest.raises(SystemExit, match="is read, and would be written over; give another --out"):
            main(["convert", "vgg19", str(vgg), "--out", str(out)])
    assert vgg.read_bytes() == before


def test_flags_of_a_runs_network_are_refused_of_published_weights(vgg, tmp_path):
    given = ["convert", "vgg19", str(vgg), "--out", str(tmp_path / "out.npz")]
    for flags, named in (
        (["--batch", "2"], "--batch is"),
        (["--to", "onnx", "--batch", "2"], "--to onnx and --batch is"),
    ):
        with pytest.raises(SystemExit, match=f"vgg19 are published weights, which become npz; {named} for generator"):
            main([*given, *flags])
    with pytest.raises(SystemExit, match=r"no kind 'vgg18'; did you mean vgg19\? Known kinds: vgg19, "):
        main(["convert", "vgg18", str(vgg), "--out", str(tmp_path / "out.npz")])


@pytest.mark.slow
def test_preparation_opens_the_penet_that_convert_writes(tmp_path, monkeypatch, capsys):
    """Half a gigabyte of zeros, of which only the first layer is told apart."""
    monkeypatch.setattr(penet, "_open", penet._open.__wrapped__)  # which keeps nothing
    arrays = {f"model.{name}": np.broadcast_to(np.float32(0), shape) for name, shape in published_shapes().items()}
    stem = np.random.default_rng(0).standard_normal(published_shapes()[STEM]).astype(np.float32)
    np.savez_compressed(tmp_path / "state.npz", **arrays | {f"model.{STEM}": stem})
    try:
        main(["convert", "penet", str(tmp_path / "state.npz"), "--out", str(tmp_path / "penet.npz")])
        network = open_penet(tmp_path / "penet.npz")
    finally:
        (tmp_path / "penet.npz").unlink(missing_ok=True)
    assert f"{len(arrays)} arrays of PENet (C2, dilation 2)" in capsys.readouterr().out
    assert (network.convention, network.width) == ("published", 32)
    kernel = np.asarray(network.values["backbone"]["rgb_conv_init"]["conv"]["kernel"])
    np.testing.assert_array_equal(kernel, stem.transpose(2, 3, 1, 0))


def test_weights_of_another_network_stop_the_command(vgg, tmp_path):
    with pytest.raises(SystemExit, match=r"is not Inception v3 of torchvision: Conv2d_1a_3x3\.conv\.weight is missing"):
        main(["convert", "inception", str(vgg), "--out", str(tmp_path / "out.npz")])


def test_an_unknown_kind_names_the_known_ones(vgg, tmp_path):
    with pytest.raises(SystemExit, match=f"Known kinds: {', '.join(CONVERTERS)}"):
        main(["convert", "vgg16", str(vgg), "--out", str(tmp_path / "out.npz")])
