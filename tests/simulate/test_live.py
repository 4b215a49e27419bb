"""The sensor in a loop: what `attach` makes is the sensor, and docs/live.md runs as it stands."""

import logging
import re
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

import jaxsim
from configs.synthetic import experiment
from jaxsim.config import GeneratorConfig, PrepareConfig
from jaxsim.data.carla import TAGS_0_9_14, intrinsics
from jaxsim.data.cityscapes import IDS
from jaxsim.data.clouds import read_cloud
from jaxsim.simulate.live import attach_rays
from tests.untrained import untrained_run

PAGE = Path(__file__).parents[2] / "docs" / "live.md"
CARLA, RAYS = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(), re.DOTALL | re.MULTILINE)
RASTERS = ("rgb", "depth_m", "depth_valid", "semantic", "instance")
SMALL = GeneratorConfig(filters=4, blocks=1, downsamples=1, enhancer_blocks=1)


@pytest.fixture(scope="module")
def sensor(tmp_path_factory):
    return jaxsim.load(untrained_run(tmp_path_factory.mktemp("live") / "run", replace(experiment, generator=SMALL)))


@pytest.fixture(scope="module")
def view():
    return jaxsim.open_dataset("synthetic")[1920].camera


@pytest.fixture(scope="module")
def live(sensor, view):
    return sensor.attach(view)


@pytest.fixture(scope="module")
def of_rays(tmp_path_factory):
    prepare = PrepareConfig(inputs=("log_range", "depth", "incidence", "row"), network_size=(88, 744), depth="given")
    made = replace(experiment, generator=SMALL, prepare=prepare)
    return jaxsim.load(untrained_run(tmp_path_factory.mktemp("live") / "rays", made))


def returned(cloud):
    valid = np.asarray(cloud.valid).reshape(-1)
    points = np.concatenate([np.asarray(cloud.xyz_m), np.asarray(cloud.intensity)[..., None]], axis=-1)
    return points.reshape(-1, 4)[valid]


@pytest.mark.long
def test_attached_it_gives_the_clouds_of_the_sensor(sensor, view, live):
    arrays = {"rgb": view.rgb, "depth_m": view.depth_m, "semantic": view.semantic, "instance": view.instance}
    expected = returned(sensor.simulate(**arrays))
    assert len(expected) > 1000
    clouds = returned(live(view))
    np.testing.assert_allclose(clouds[:, :3], expected[:, :3], atol=1e-5)
    # Two programs round in their own way, and reported intensities lie on steps of 1/100.
    steps = np.abs(clouds[:, 3] - expected[:, 3]) / 0.01
    assert steps.max() < 1.01
    assert (steps > 0.01).mean() < 1e-3


@pytest.mark.long
def test_a_batch_is_its_views(sensor, view, live):
    two = view.replace(**{k: np.stack([getattr(view, k)] * 2) for k in ("rgb", "depth_m", "depth_valid", "semantic")})
    two = two.replace(instance=np.stack([view.instance] * 2))
    clouds = sensor.attach(two)(two)
    assert clouds.valid.shape[0] == 2
    np.testing.assert_allclose(returned(clouds), np.tile(returned(live(view)), (2, 1)), atol=0.011)
    with pytest.raises(ValueError, match=r"it was attached to \(375, 1242\): attach again"):
        live(two)


@pytest.mark.long
def test_views_that_do_not_fit_are_told(sensor, view, live):
    with pytest.raises(ValueError, match="has no depth"):
        live(view.replace(depth_m=None))
    with pytest.raises(ValueError, match="need class labels"):
        sensor.attach(view.replace(semantic=None))
    with pytest.raises(ValueError, match="render at 1242 x 375"):
        sensor.attach(view.replace(**{k: getattr(view, k)[:200] for k in RASTERS}))


def test_buffers_of_another_kind_are_told_at_every_tick(sensor, view, live):
    kilometres = view.replace(depth_m=view.depth_m / 1000)
    for look in (live, sensor.attach):
        with pytest.raises(ValueError, match=r"live: depth_m .* it must be in metres: multiply"):
            look(kilometres)
        with pytest.raises(ValueError, match=r"live: rgb is \(375, 1242, 4\).* leave the alpha channel out"):
            look(view.replace(rgb=np.concatenate([view.rgb, view.rgb[..., :1]], -1)))
        with pytest.raises(ValueError, match=r"live: semantic spans -\d+\.\."):
            look(view.replace(semantic=np.asarray(view.semantic, np.int32) - 33))
    # A simulator may look into the sky; what it is compiled for must be a street.
    sky = view.replace(depth_valid=np.zeros_like(view.depth_valid))
    assert not np.asarray(live(sky).valid).any()
    with pytest.raises(ValueError, match="known in no pixel"):
        sensor.attach(sky)


def test_the_latency_is_logged(of_rays, caplog):
    with caplog.at_level(logging.INFO, logger="jaxsim"):
        of_rays.attach_rays()
    assert re.search(r"live: 44 x 372 rays, \d+ ms a call", caplog.text)


def test_rays_of_the_embedded_sensor_need_a_camera(sensor):
    with pytest.raises(ValueError, match="trained on rgb, which rays do not know"):
        sensor.attach_rays()


def test_rays_that_are_given_wrongly_are_told(of_rays):
    live = of_rays.attach_rays()
    with pytest.raises(ValueError, match="cast `directions`, 44 x 372 rays"):
        live(np.ones((44, 371), np.float32))
    with pytest.raises(ValueError, match=r"live: range_m .* divide millimetres by 1000"):
        live(np.full((44, 372), 12_000, np.float32))
    with pytest.raises(ValueError, match=r"incidence_rad spans 45\.\.45; .* turn degrees into radians"):
        live(np.full((44, 372), 12, np.float32), incidence_rad=np.full((44, 372), 45, np.float32))
    with pytest.raises(ValueError, match=r"live: semantic spans 0\.\.255"):
        live(np.full((44, 372), 12, np.float32), semantic=np.arange(44 * 372).reshape(44, 372) % 256)
    with pytest.raises(ValueError, match=r"live: range_m is a masked array"):
        live(np.ma.masked_greater(np.full((44, 372), 12, np.float32), 50))
    nothing = live(np.full((44, 372), np.nan, np.float32))
    assert not np.asarray(nothing.valid).any()


def test_a_ray_alone_has_the_angle_that_it_had_in_training(of_rays):
    def slant(params, inputs):
        """Not a network: the incidence, in right angles."""
        return inputs[..., 2:3]

    live = attach_rays(of_rays.run, None, of_rays.window, generate=slant)
    range_m = np.zeros((44, 372), np.float32)
    range_m[20, 100] = 12.0
    np.testing.assert_allclose(returned(live(range_m))[:, 3], [0.99], atol=1e-6)


def test_labels_of_rays_that_end_nowhere_are_none(of_rays):
    """As in painted frames, which the network learned from: a caster may call them sky."""
    painted = []
    attached = of_rays.attach_rays()

    def run(one, incidence):
        painted.append(one)
        return attached.run(one, incidence)

    live = replace(attached, run=run)
    range_m = np.full((44, 372), 12, np.float32)
    range_m[:8] = np.inf
    live(range_m, semantic=np.full((44, 372), 23), instance=np.full((44, 372), 5))
    [one] = painted
    for labels, at_ends in ((one.semantic, 23), (one.instance, 5)):
        np.testing.assert_array_equal(labels, np.where(np.isinf(range_m), 0, at_ends))


def bgra(red, green, blue) -> bytes:
    return np.stack([blue, green, red, np.full(np.shape(red), 255)], -1).astype(np.uint8).tobytes()


class World:
    """A recorded tick of a server: what CARLA's own classes give a client."""

    def __init__(self, buffers):
        self.buffers, self.listeners, self.ticks = buffers, {}, 0

    def get_world(self):
        return self

    def get_actors(self):
        return SimpleNamespace(filter=lambda pattern: ["car"])

    def get_blueprint_library(self):
        return SimpleNamespace(find=lambda kind: SimpleNamespace(kind=kind, set_attribute=lambda name, value: None))

    def spawn_actor(self, camera, place, *, attach_to):
        assert attach_to == "car"
        kind = camera.kind.removeprefix("sensor.camera.")
        return SimpleNamespace(listen=lambda take: self.listeners.update({kind: take}))

    def tick(self):
        self.ticks += 1
        for kind, take in self.listeners.items():
            take(SimpleNamespace(raw_data=memoryview(self.buffers[kind])))
        return self.ticks


def test_carlas_script_writes_the_clouds_of_its_buffers(sensor, view, monkeypatch, tmp_path):
    tags = np.array([TAGS_0_9_14.index(next((n for n, i in IDS.items() if i == k and n in TAGS_0_9_14), "unlabeled"))
                     for k in range(34)])  # fmt: skip
    code = np.where(view.depth_valid, np.round(view.depth_m / 1000 * (2**24 - 1)), 2**24 - 1).astype(np.int64)
    zero = np.zeros(code.shape)
    world = World({
        "rgb": bgra(*np.moveaxis(np.asarray(view.rgb), -1, 0)),
        "depth": bgra(code % 256, code // 256 % 256, code // 65536),
        "semantic_segmentation": bgra(tags[np.asarray(view.semantic)], zero, zero),
    })  # fmt: skip
    module = ModuleType("carla")
    module.Client = lambda host, port: world
    module.Transform = module.Location = lambda *args, **kwargs: None
    monkeypatch.setitem(sys.modules, "carla", module)
    monkeypatch.setattr(jaxsim, "load", lambda name: sensor)
    monkeypatch.chdir(tmp_path)
    exec(compile(CARLA.replace("range(100)", "range(2)"), str(PAGE), "exec"), {})
    assert world.ticks == 2
    one, two = (read_cloud(tmp_path / "clouds" / f"{k:06d}.bin") for k in (1, 2))
    np.testing.assert_array_equal(one, two)
    # The buffers hold CARLA's classes, which are fewer, and no objects' numbers.
    classes = np.array([IDS[name] for name in TAGS_0_9_14], np.int32)[tags[np.asarray(view.semantic)]]
    # Its camera looks along its own middle, KITTI's does not.
    fov = 2 * np.rad2deg(np.arctan(1242 / 2 / sensor.run.intrinsics[0][0]))
    camera = view.camera.replace(
        intrinsics=intrinsics((375, 1242), fov), cam_from_velo=np.array(sensor.run.cam_from_velo)
    )
    seen = view.replace(semantic=classes, instance=None, camera=camera)
    expected = returned(sensor.attach(seen)(seen))
    assert len(one) > 1000
    assert len(one) == pytest.approx(len(expected), rel=0.003)


def test_a_ray_casters_script_hits_the_walls_of_its_room(of_rays, monkeypatch, tmp_path):
    trimesh = pytest.importorskip("trimesh")
    pytest.importorskip("embreex")
    room = trimesh.creation.box((40, 30, 4))
    room.apply_translation((0, 0, 0.3))
    room.export(tmp_path / "street.ply")
    monkeypatch.setattr(jaxsim, "load", lambda name: of_rays)
    monkeypatch.chdir(tmp_path)
    space = {}
    exec(compile(RAYS, str(PAGE), "exec"), space)
    cloud = returned(space["cloud"])
    assert len(cloud) > 8000
    # Each point lies on a wall, the floor or the ceiling.
    off = np.abs(np.abs(cloud[:, :3] - (0, 0, 0.3)) - (20, 15, 2)).min(-1)
    assert off.max() < 1e-3
    assert (tmp_path / "street.pcd").stat().st_size > 8000 * 16
    # Without the caster's angles these are told from the ranges, which gives the same but at the room's edges.
    size = space["live"].directions.shape[:2]
    told = space["live"](space["range_m"].reshape(size))
    same = np.asarray(told.intensity) == np.asarray(space["cloud"].intensity)
    assert same.mean() > 0.8
