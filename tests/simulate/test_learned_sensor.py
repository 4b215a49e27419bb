"""The learned sensor on a renderer's views and on plain arrays."""

from dataclasses import replace
from functools import partial
from inspect import unwrap

import jax
import numpy as np
import pytest

from configs.kitti_drives import experiment as drives
from jaxsim.config import PrepareConfig
from jaxsim.data import open_dataset
from jaxsim.data.vkitti2 import VirtualKitti2
from jaxsim.frame import CameraFrame
from jaxsim.simulate.learned_sensor import LearnedSensor, load
from tests.untrained import untrained_run


def test_the_map_over_the_image_is_what_the_command_predicts_and_ends_at_the_crop(step_run, virtual):
    sensor = load(step_run)
    view = VirtualKitti2(virtual.root, scenes=("Scene01",))[0].camera
    intensity = sensor.intensity_map(view)
    assert intensity.shape == (375, 1242)
    assert not intensity[:23].any()
    assert not intensity[:, :13].any()
    assert not intensity[:, -13:].any()
    assert intensity[23:, 13:-13].any()
    assert intensity.max() <= np.float32(0.99)


def test_plain_arrays_give_a_cloud_and_must_be_like_the_runs_images(step_run, virtual):
    view = VirtualKitti2(virtual.root, scenes=("Scene01",))[0].camera
    sensor = load(step_run)
    arrays = {"rgb": view.rgb, "depth_m": view.depth_m, "semantic": view.semantic, "instance": view.instance}
    cloud = sensor.simulate(**arrays, camera=view.camera)
    assert np.asarray(cloud.valid).sum() > 500
    with pytest.raises(ValueError, match=r"621 x 375, an aspect ratio of 1\.66"):
        sensor.simulate(**{name: raster[:, :621] for name, raster in arrays.items()}, camera=view.camera)


def test_a_unet_looks_as_often_as_it_is_asked_to_and_tells_that_it_is_another_sensor(step_run, tmp_path):
    prepare = PrepareConfig(inputs=("depth", "incidence", "row"), network_size=(16, 24), depth="given")
    experiment = replace(drives, prepare=prepare, generator=replace(drives.generator, filters=4))
    four = load(untrained_run(tmp_path / "unet", experiment))
    once = four.looking(1)
    inputs = np.random.default_rng(0).uniform(-1, 1, (1, 16, 24, 15)).astype(np.float32)
    mean, plain = (np.asarray(sensor.generate(sensor.params, inputs)) for sensor in (four, once))
    assert mean.shape == plain.shape
    assert np.abs(mean - plain).max() > 1e-3
    assert once.fingerprint != four.fingerprint
    assert four.looking(4).fingerprint == four.fingerprint
    with pytest.raises(ValueError, match="a unet looks several ways, imaginaire does not; leave looks out"):
        load(step_run).looking(2)


def test_a_sensor_with_other_weights_of_depth_is_another_wherever_they_lie(tmp_path):
    embedded = load("embedded")

    def fingerprint(weights):
        experiment = embedded.run.experiment
        prepare = replace(experiment.prepare, depth="penet", depth_weights=weights)
        run = replace(embedded.run, experiment=replace(experiment, prepare=prepare))
        return LearnedSensor(run, embedded.params).fingerprint

    one, copied = tmp_path / "one.npz", tmp_path / "copied.npz"
    one.write_bytes(b"one")
    first = fingerprint(one)
    assert fingerprint(one.rename(copied)) == first
    copied.write_bytes(b"two")
    assert len({fingerprint(copied), fingerprint(tmp_path / "none.npz"), embedded.fingerprint, first}) == 4


@pytest.fixture(scope="module")
def raw():
    """What a user has: the arrays of a view, and a sensor that simulates them without the tests' check of types."""
    view = open_dataset("synthetic")[1920].camera
    arrays = {"rgb": view.rgb, "depth_m": view.depth_m, "semantic": view.semantic, "instance": view.instance}
    sensor = load("embedded")
    return {k: np.asarray(v) for k, v in arrays.items()}, partial(unwrap(LearnedSensor.simulate), sensor), sensor


WRONG = {
    "rgb of 0..1": ({"rgb": lambda a: (a / 255).astype(np.float32)}, "rgb holds float32; .* multiply 0..1 by 255"),
    "rgb of 16 bits": ({"rgb": lambda a: a.astype(np.uint16) * 256}, "rgb holds uint16; .* divide 16 bits by 256"),
    "RGBA": ({"rgb": lambda a: np.concatenate([a, a[..., :1]], -1)}, "leave the alpha channel out"),
    "channels first": ({"rgb": lambda a: np.moveaxis(a, -1, 0)}, "put the channels last"),
    "millimetres": ({"depth_m": lambda a: a * 1000}, "divide millimetres by 1000"),
    "centimetres": ({"depth_m": lambda a: a * 100}, "divide millimetres by 1000, centimetres .* by 100"),
    "kilometres": ({"depth_m": lambda a: a / 1000}, "kilometres by 1000"),
    "KITTI's file": ({"depth_m": lambda a: (np.clip(a, 0, 255) * 256).astype(np.uint16)}, "KITTI's files by 256"),
    "0..1": ({"depth_m": lambda a: a / 200}, "multiply 0..1 by the far plane's distance"),
    "0..1 of near": ({"depth_m": lambda a: np.clip(a / 40, 0, 1)}, "multiply 0..1 by the far plane's distance"),
    "a picture": ({"depth_m": lambda a: np.clip(a, 0, 255).astype(np.uint8)}, "no picture of the depth"),
    "an inverse": ({"depth_m": lambda a: 1 / np.maximum(a, 1)}, "take 1 / x of an inverse depth"),
    "behind": ({"depth_m": lambda a: -a}, "turn the sign"),
    "nothing": ({"depth_m": lambda a: 0 * a}, "known in no pixel"),
    "turned": ({"depth_m": lambda a: a.T}, r"depth_m is \(1242, 375\), rgb .*np.swapaxes\(depth_m, -1, -2\)"),
    "a row short": ({"depth_m": lambda a: a[1:]}, "render image, depth and labels at one size"),
    "a channel": ({"depth_m": lambda a: a[..., None]}, r"squeeze it, depth_m\[..., 0\]"),
    "a picture of classes": ({"semantic": lambda a: np.stack([a] * 3, -1)}, "must be decoded by its colours"),
    "ids below 0": ({"semantic": lambda a: a.astype(np.int32) - 33}, r"semantic spans -\d+\.\..* Cityscapes ids 0..33"),
    "ids beyond": ({"semantic": lambda a: a + 30}, "Cityscapes ids 0..33"),
    "a mask": ({"semantic": lambda a: a > 0}, "semantic holds bool; it must be Cityscapes ids"),
    "objects as floats": ({"instance": lambda a: a.astype(np.float32)}, "instance holds float32; .*astype"),
}


def test_lists_are_taken_for_the_arrays_that_they_are(raw):
    arrays, simulate, _ = raw
    lists = {name: arrays[name].tolist() for name in ("depth_m", "semantic", "instance")}
    jax.tree.map(np.testing.assert_array_equal, simulate(**arrays | lists), simulate(**arrays))
    masked = np.ma.masked_array(arrays["semantic"], mask=arrays["semantic"] == 23)
    with pytest.raises(ValueError, match="simulate: semantic is a masked array"):
        simulate(**arrays | {"semantic": masked})


def test_what_names_no_run_is_answered_with_what_does():
    with pytest.raises(ValueError, match=r"run: None came; give the folder that `jaxsim train` made, or 'embedded'"):
        unwrap(load)(None)


@pytest.mark.parametrize("what", WRONG)
def test_arrays_that_are_not_what_they_must_be_are_told_with_what_to_do(raw, what):
    arrays, simulate, sensor = raw
    changes, message = WRONG[what]
    wrong = arrays | {name: change(arrays[name]) for name, change in changes.items()}
    with pytest.raises(ValueError, match=message):
        simulate(**wrong)
    view = CameraFrame(camera=sensor.run.camera, depth_valid=np.ones(arrays["depth_m"].shape, bool), **wrong)
    with pytest.raises(ValueError, match="simulate: "):
        sensor.intensity_map(view)


@pytest.mark.long
def test_an_empty_cloud_is_warned_of(raw, monkeypatch):
    arrays, simulate, sensor = raw
    above = np.zeros_like(arrays["depth_m"])
    above[30:50] = 10
    with pytest.warns(UserWarning, match="no ray comes back; no pixel with depth lies on one"):
        nothing = simulate(**arrays | {"depth_m": above})
    assert not np.asarray(nothing.valid).any()
    whole = sensor.simulate_view

    def dark(*of, **more):
        image, painted = whole(*of, **more)
        return replace(image, valid=np.zeros(image.valid.shape, bool)), painted

    monkeypatch.setattr(sensor, "simulate_view", dark)
    with pytest.warns(UserWarning, match="no ray comes back; the network drops all of them"):
        simulate(**arrays)
