"""Trained weights in use."""

import os
from functools import partial

import jax
import numpy as np
import pytest

from jaxsim.config import PenetConfig, PrepareConfig, Stage
from jaxsim.prepare.depth import complete_depth, complete_view
from jaxsim.prepare.depth.penet import open_penet, save_penet
from jaxsim.prepare.depth.penet.training import (
    create_state,
)
from tests.prepare.depth.penet.made_training import view

CROP = (32, 64)
STAGES = tuple(Stage(part, 1, 2, CROP, ()) for part in ("branches", "refinement", "joint"))
CONFIG = PenetConfig(width=2, stages=STAGES)
INTRINSICS = np.array([[60.0, 0, 40], [0, 60, 20], [0, 0, 1]], np.float32)


@pytest.fixture(autouse=True)
def optax_promotes():
    """optax raises a float to an int."""
    with jax.numpy_dtype_promotion("standard"):
        yield


@pytest.mark.long
def test_trained_weights_complete_a_view(tmp_path):
    state = create_state(CONFIG, seed=1)
    save_penet(tmp_path / "weights.npz", jax.tree.map(np.asarray, state.values))
    camera, frame = view()
    garbage = np.where(frame.given, frame.sparse_m, np.nan).astype(np.float32)
    done = complete_view(camera, garbage, frame.given, method="penet", weights=tmp_path / "weights.npz")
    assert done.depth_m.shape == (64, 96)
    assert np.isfinite(done.depth_m).all()
    assert (done.depth_m[done.depth_valid] > 0).all()
    network = open_penet(tmp_path / "weights.npz")
    assert (network.convention, network.width) == ("exact", 2)
    # What the crop took off the top concerns the published weights alone.
    complete = partial(network, frame.rgb, garbage, frame.given, intrinsics=INTRINSICS)
    np.testing.assert_array_equal(complete(rows_cut=23)[0], complete()[0])


def test_a_file_that_was_written_anew_is_read_anew(tmp_path):
    path, found = tmp_path / "weights.npz", []
    for seed in (1, 2):
        save_penet(path, jax.tree.map(np.asarray, create_state(CONFIG, seed=seed).values))
        os.utime(path, ns=(seed, seed))
        found.append(jax.tree.leaves(open_penet(path).values)[0])
    assert open_penet(path) is open_penet(path)
    assert not np.array_equal(*found)


def test_bad_input_says_what_to_do(tmp_path):
    camera, frame = view()
    with pytest.raises(ValueError, match=r"penet needs its weights.*--prepare\.depth-weights"):
        complete_view(camera, frame.sparse_m, frame.given, method="penet")
    with pytest.raises(FileNotFoundError, match="jaxsim convert penet FILE"):
        complete_view(camera, frame.sparse_m, frame.given, method="penet", weights=tmp_path / "none.npz")
    save_penet(tmp_path / "weights.npz", jax.tree.map(np.asarray, create_state(CONFIG, seed=1).values))
    network = open_penet(tmp_path / "weights.npz")
    with pytest.raises(ValueError, match="not one pixel has depth"):
        network(frame.rgb, frame.sparse_m, np.zeros((64, 96), bool), intrinsics=INTRINSICS)
    with pytest.raises(ValueError, match=r"60 x 96 pixels; both must be multiples of 32: --prepare\.image-crop 32 96"):
        network(frame.rgb[:60], frame.sparse_m[:60], frame.given[:60], intrinsics=INTRINSICS)
    with pytest.raises(ValueError, match="penet also takes the image"):
        complete_depth(frame.sparse_m, frame.given, "penet")
    assert PrepareConfig(depth="penet").depth_weights is None
