"""Programs for accelerators, made where there is none: what a GPU or a TPU would run lowers for both, and rounds no
factor of a product to fewer digits than float32 has where it is no network that is trained.

A program is traced from the shapes of small inputs; nothing is computed, and nothing is compiled.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim.config import PenetConfig, Stage
from jaxsim.data.synthetic import kitti_camera
from jaxsim.detect import make_train_step as make_detector_step
from jaxsim.detect import steps as detector
from jaxsim.detect.steps import make_detect
from jaxsim.discover.model.evidence import gather
from jaxsim.discover.model.gradients import effect_with_gradient
from jaxsim.discover.model.likelihood import log_likelihood
from jaxsim.discover.model.noise import START
from jaxsim.discover.model.parameters import to_z
from jaxsim.discover.model.random_effects import normal_equations
from jaxsim.effects import EFFECTS, all_rays
from jaxsim.frame import CameraFrame, Cloud, DepthFrame
from jaxsim.geometry import points_to_polar, polar_to_points, preset
from jaxsim.geometry.boxes import nms_bev
from jaxsim.metrics import bev
from jaxsim.metrics.inception import random_extractor
from jaxsim.metrics.sliced_wasserstein import sliced
from jaxsim.pix2pix import make_train_step, state_shapes
from jaxsim.prepare import input_channels
from jaxsim.prepare.denoise.lidia import Variant, apply, from_published, published_shapes
from jaxsim.prepare.depth.penet.training import create_state as create_penet
from jaxsim.prepare.depth.penet.training import train_step as train_penet
from jaxsim.runs.run import describe_run
from jaxsim.simulate.learned_sensor import LearnedSensor
from jaxsim.train.experiments import load_experiment
from tests.detect import tiny
from tests.discover.toy import device, toy
from tests.prepare.lidia_oracle import random_state
from tests.small_training import CHANNELS, EXPERIMENT, SIZE
from tests.untrained import tiny_experiment

ACCELERATORS = ("cuda", "tpu")
Program = tuple[Callable[..., Any], tuple[Any, ...]]
"""A function, and the shapes of its arguments."""


def f32(*shape: int, dtype: Any = jnp.float32) -> jax.ShapeDtypeStruct:
    return jax.ShapeDtypeStruct(shape, dtype)


def shapes(tree: Any) -> Any:
    return jax.tree.map(lambda leaf: f32(*np.shape(leaf), dtype=jnp.asarray(leaf).dtype), tree)


def simulation() -> Program:
    """From a camera's view to what the LiDAR reports."""
    experiment = tiny_experiment()
    crop = experiment.prepare.image_crop
    run = describe_run(experiment, preset("hdl64e"), CameraFrame(np.zeros((375, 1242, 3), np.uint8), kitti_camera()))
    sensor = LearnedSensor(run, state_shapes(experiment, input_channels(experiment.prepare)).ema)
    grid, row = sensor.window
    raster = partial(f32, 1, *crop)
    view = CameraFrame(
        raster(3, dtype=jnp.uint8),
        jax.tree.map(lambda leaf: f32(1, *leaf.shape), run.camera),
        depth_m=raster(),
        depth_valid=raster(dtype=jnp.bool_),
        semantic=raster(dtype=jnp.int32),
        instance=raster(dtype=jnp.int32),
    )
    return partial(sensor._simulate["lidar"], grid=grid, row_share=row), (sensor.params, view)


def intensity_training() -> Program:
    batch = {"inputs": f32(2, *SIZE, CHANNELS), "target": f32(2, *SIZE, 1), "weight": f32(2, *SIZE)}
    return make_train_step(EXPERIMENT, CHANNELS), (state_shapes(EXPERIMENT, CHANNELS), batch)


def detector_training() -> Program:
    state = jax.eval_shape(lambda: detector._create(tiny.EXPERIMENT, 10, jax.random.key(0)))
    return make_detector_step(tiny.EXPERIMENT, 10), (state, shapes(tiny.scene_batch([0, 1])))


def detection() -> Program:
    batch = shapes(tiny.scene_batch([0]))
    return make_detect(tiny.EXPERIMENT), (detector.network_shapes(tiny.EXPERIMENT), batch["points"], batch["valid"])


def depth_training() -> Program:
    config = PenetConfig(width=2, stages=(Stage("joint", 1, 2, (32, 64), ()),))
    raster = partial(f32, 2, 32, 64)
    batch = DepthFrame(
        raster(3, dtype=jnp.uint8),
        raster(),
        raster(dtype=jnp.bool_),
        raster(),
        raster(dtype=jnp.bool_),
        intrinsics=f32(2, 3, 3),
    )
    state = jax.eval_shape(lambda: create_penet(config, 0))
    step = partial(train_penet, config=config, part="joint")
    return lambda state, batch, lr, weight: step(state, batch, lr, weight=weight), (state, batch, f32(), f32())


def denoising() -> Program:
    variant = Variant()
    _, values = from_published(random_state(published_shapes(variant), seed=0))
    measured = f32(1, 24, 40, dtype=jnp.bool_)
    denoise = partial(apply, variant=variant, statistics="image")
    return denoise, (shapes(values), f32(1, 24, 40, 1), measured)


def discovery() -> Program:
    """An effect of geometry on rays that are cast again, with its derivatives."""
    scan, _ = toy(frames=2)
    rays = jax.eval_shape(all_rays, scan)
    effect = EFFECTS["extrinsic_rotation"]
    z = to_z(effect, {"yaw_rad": 0.02, "pitch_rad": -0.01, "roll_rad": 0.01}, 16)
    found = lambda z, rays, scan: effect_with_gradient(effect, z, rays, scan=scan)[:2]  # noqa: E731
    return found, (shapes(z), rays, shapes(scan))


def null_model() -> Program:
    """Levels of reflectance and poses in closed form, and how likely they make the frames."""
    frames = np.arange(2)
    columns = np.broadcast_to(np.arange(0, 60, 4), (2, 15))
    evidence = gather(*device(*toy(frames=2)), frame=frames, column=columns, scene=frames)
    off = f32(*evidence.edge.shape)

    def likely(ev: Any, noise: Any, off: Any) -> Any:
        equations = normal_equations(ev, noise, (off, off))
        return log_likelihood(ev, noise, equations=equations, in_fit=jnp.ones(len(ev.scene)), clutter=False)

    return likely, (shapes(evidence), shapes(START), off)


def clouds() -> Program:
    """Points to a polar image and back, thinned, and as histograms."""
    experiment, _ = load_experiment("synthetic")
    run = describe_run(experiment, preset("hdl64e"), CameraFrame(np.zeros((375, 1242, 3), np.uint8), kitti_camera()))
    grid, _ = LearnedSensor(run, {}).window

    def there_and_back(cloud: Cloud) -> tuple[Any, ...]:
        image, _ = points_to_polar(cloud, grid)
        return polar_to_points(image, grid), bev.lidargen_counts(cloud.xyz_m[None], cloud.valid[None])

    return there_and_back, (Cloud(f32(500, 3), f32(500), f32(500, dtype=jnp.bool_), row=f32(500, dtype=jnp.int32)),)


def distances() -> Program:
    """Of patches and of histograms, and what Inception sees."""
    extractor = random_extractor(64)

    def compared(a: Any, b: Any, directions: Any, difference: Any, images: Any) -> tuple[Any, ...]:
        return sliced(a, b, directions), bev._spectral_squares(difference), extractor(images)

    return compared, (f32(20, 49), f32(20, 49), f32(49, 8), f32(2, 12, 10), f32(1, 32, 64, 1))


def boxes() -> Program:
    return partial(nms_bev, keep=8, consider=16), (f32(40, 7), f32(40), f32())


EXACT = (denoising, discovery, null_model, clouds, distances, boxes)
NETWORKS = (simulation, intensity_training, detection)
"""Whose layers take what the device prefers."""
LONG = (detector_training, depth_training)


def lowered(program: Callable[[], Program]) -> str:
    function, arguments = program()
    return jax.jit(function).trace(*arguments).lower(lowering_platforms=ACCELERATORS).as_text()


@pytest.mark.usefixtures("standard_promotion")
@pytest.mark.parametrize(
    "program",
    [*EXACT, *NETWORKS, *(pytest.param(program, marks=pytest.mark.slow) for program in LONG)],
    ids=lambda program: program.__name__,
)
def test_it_lowers_for_a_gpu_and_a_tpu(program: Callable[[], Program], monkeypatch):
    monkeypatch.setattr(jax, "default_backend", lambda: "cuda")  # by which jaxsim chooses among forms
    text = lowered(program)
    assert "mhlo.num_partitions" in text
    assert "__cpu$" not in text  # custom calls that only XLA's CPU knows
    assert "@jaxsim_" not in text  # and ours


@pytest.mark.usefixtures("standard_promotion")
@pytest.mark.parametrize("program", EXACT, ids=lambda program: program.__name__)
def test_no_accelerator_rounds_the_factors_of_its_products(program: Callable[[], Program], monkeypatch):
    monkeypatch.setattr(jax, "default_backend", lambda: "cuda")
    products = [line for line in lowered(program).splitlines() if "dot_general" in line or "stablehlo.conv" in line]
    rounded = [line.strip() for line in products if "stablehlo.convert" not in line and "HIGHEST" not in line]
    assert not rounded
