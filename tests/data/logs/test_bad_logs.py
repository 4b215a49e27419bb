"""Of every reader what cannot be read, through the door of `jaxsim frames`: cut off, of another sensor or profile,
without rings, in another frame, empty. Byte orders and more damage stand in the readers' own tests, and in tests/fuzz.
"""

import shutil
from pathlib import Path

import numpy as np
import pytest

from tests.data.logs.conftest import room
from tests.data.logs.made_logs import (
    carla_buffer,
    detections,
    frames_of,
    las,
    mcap,
    message,
    osi_mcap,
    osi_trace,
    pcd,
    ros1_bag,
    ros2_bag,
    sensor_view,
)

SWEEP = "n015-2018-07-24-11-22-45+0800__LIDAR_TOP__1532402927647951.pcd.bin"


def nothing():
    """A turn without points."""
    return {name: values[:0] for name, values in room().items()}


def ringless():
    """Points that do not fall into lines, and have no ring."""
    fields = room()
    del fields["ring"]
    return fields | {"z": fields["z"] + np.random.default_rng(0).normal(0, 0.2, len(fields["z"])).astype("f4")}


def cut(path: Path, share: float) -> Path:
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    return path


def copied(source: Path, target: Path, share: float = 1.0) -> Path:
    target.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(source, target)
    return cut(target, share)


def ply(path, fields):
    plyfile = pytest.importorskip("plyfile", reason="plyfile is not installed")
    vertices = np.empty(len(fields["x"]), [(name, value.dtype) for name, value in fields.items()])
    for name, value in fields.items():
        vertices[name] = value
    plyfile.PlyData([plyfile.PlyElement.describe(vertices, "vertex")]).write(str(path))
    return path


def without_lidar(data, view=True):
    if view:
        del data.lidar_sensor_view[:]
    else:
        del data.feature_data.lidar_sensor[:]
    return data


def without_beams(data):
    for detection in data.feature_data.lidar_sensor[0].detection:
        detection.ClearField("beam_id")
    return data


def scattered_detections():
    return without_beams(detections(ringless() | {"ring": room()["ring"]}))


def bag_without_data(folder):
    next(ros2_bag(folder / "bag", room()).glob("*.db3")).unlink()
    return folder / "bag"


def cut_bag(folder):
    cut(next(ros2_bag(folder / "bag", room()).glob("*.db3")), 0.5)
    return folder / "bag"


def emptied(folder, name):
    carla_buffer(folder, room(), semantic=False)
    (folder / name).write_bytes(b"")
    return folder


def of_the_other_lidar(folder):
    carla_buffer(folder, room(), semantic=True)
    about = folder / "attributes.json"
    about.write_text(about.read_text().replace("ray_cast_semantic", "ray_cast"))
    return folder


def range_image(folder, scan):
    np.savez(folder / "000.npz", scan=scan)
    return folder


NO_POINT = "no point of .* came back"
NO_RING = "the points have no ring, and their elevations do not fall into lines"
MADE = {
    "a pcd of no point": (lambda d: pcd(d / "a.pcd", nothing(), "binary"), {}, f"pcd: .*{NO_POINT}"),
    "a pcd without ring": (lambda d: pcd(d / "a.pcd", ringless(), "binary"), {}, f"pcd: .*{NO_RING}"),
    "a ply of no point": (lambda d: ply(d / "a.ply", nothing()), {}, f"ply: .*{NO_POINT}"),
    "a ply without ring": (lambda d: ply(d / "a.ply", ringless()), {}, f"ply: .*{NO_RING}"),
    "a las of no point": (lambda d: las(d / "a.las", nothing()), {}, f"las: .*{NO_POINT}"),
    "a las without ring": (lambda d: las(d / "a.las", ringless(), ring=False), {}, f"las: .*{NO_RING}"),
    "an mcap of no point": (lambda d: mcap(d / "a.mcap", [message(nothing())]), {}, f"ros: .*{NO_POINT}"),
    "an mcap of no message": (lambda d: mcap(d / "a.mcap", []), {}, "no topic of sensor_msgs/PointCloud2"),
    "an mcap without ring": (lambda d: mcap(d / "a.mcap", [message(ringless())]), {}, f"ros: .*{NO_RING}"),
    "a bag that is cut off": (cut_bag, {}, "ros: .*bag cannot be read .*ros2 bag reindex"),
    "a bag whose data is not there": (bag_without_data, {}, r"ros: .*bag cannot be read .*database files are missing"),
    "a bag in another frame": (lambda d: ros2_bag(d / "bag", room()), {"frame": "map"}, "'lidar_top', not in 'map'"),
    "a ROS 1 bag that is cut off": (lambda d: cut(ros1_bag(d / "a.bag", room()), 0.5), {}, r"a.bag cannot be read"),
    "an empty ROS 1 bag": (lambda d: cut(ros1_bag(d / "a.bag", room()), 0), {}, r"a.bag cannot be read .*empty"),
    "a ROS 1 bag in another frame": (
        lambda d: ros1_bag(d / "a.bag", room()),
        {"frame": "map"},
        "'lidar_top', not in 'map'",
    ),
    "a SensorView of no ray": (
        lambda d: osi_trace(d / "a_sv_3.osi", sensor_view(nothing())),
        {},
        f"osi: .*{NO_POINT}",
    ),
    "a SensorView without LiDAR": (
        lambda d: osi_trace(d / "a_sv_3.osi", without_lidar(sensor_view(room()))),
        {},
        "osi: .*a SensorView without lidar_sensor_view",
    ),
    "a SensorData without LiDAR": (
        lambda d: osi_trace(d / "a_sd_3.osi", without_lidar(detections(room()), view=False)),
        {},
        "osi: .*a SensorData without feature_data.lidar_sensor",
    ),
    "a SensorView that is called a SensorData": (
        lambda d: osi_trace(d / "a_sd_3.osi", sensor_view(room())),
        {},
        "osi: .*a SensorData without feature_data.lidar_sensor",
    ),
    "detections without beams": (
        lambda d: osi_trace(d / "a_sd_3.osi", scattered_detections()),
        {},
        f"osi: .*{NO_RING}",
    ),
    "another topic of an OSI trace": (
        lambda d: osi_mcap(d / "a.mcap", room()),
        {"topic": "Other"},
        "osi: .*no SensorView or SensorData on Other; there is SensorViewTopic",
    ),
    "an OSI trace in MCAP that is cut off": (
        lambda d: cut(osi_mcap(d / "a.mcap", room()), 0.5),
        {},
        r"a\.mcap cannot be read .*mcap recover",
    ),
    "an empty buffer of CARLA": (lambda d: emptied(d, "000010.raw"), {}, "carla: .*raw has 0 bytes"),
    "a buffer of CARLA's other LiDAR": (of_the_other_lidar, {}, "degrees off the beams of attributes.json"),
    "an empty range image": (
        lambda d: range_image(d, np.zeros((0, 0, 6), np.float32)),
        {"sensor": "hdl32e"},
        "range images: .*000.npz",
    ),
    "a range image of no return": (
        lambda d: range_image(d, np.zeros((32, 90, 6), np.float32)),
        {"sensor": "hdl32e"},
        f"range_images: .*{NO_POINT}",
    ),
    "an OSF that is none": (lambda d: bytes_of(d / "a.osf", bytes(100)), {}, r"ouster: .*a\.osf cannot be read"),
}


def bytes_of(path, content):
    path.write_bytes(content)
    return path


@pytest.mark.parametrize("bad", MADE)
def test_what_cannot_be_read_is_told(tmp_path, bad):
    make, options, told = MADE[bad]
    if bad == "an OSF that is none":
        pytest.importorskip("ouster.sdk", reason="ouster-sdk is not installed")
    with pytest.raises(ValueError, match=rf"(?s){told}"):
        frames_of(make(tmp_path), tmp_path / "out", **options)


def ouster(samples, folder, share, description="OS-1"):
    source = next((samples / "ouster").glob("OS-1*.pcap"))
    copied(next((samples / "ouster").glob(f"{description}*.json")), folder / "a.json")
    return copied(source, folder / "a.pcap", share)


def velodyne(samples, folder, share):
    return copied(samples / "velodyne_vlp16/my.pcap", folder / "a.pcap", share)


def nuscenes(samples, folder, share):
    copied(next(samples.glob("nuscenes/**/*.pcd.bin")), folder / "samples/LIDAR_TOP" / SWEEP, share)
    return folder / "samples"


def kitti(samples, folder, share):
    scan = next(samples.glob("kitti_raw/**/velodyne_points/data/*.bin"))
    copied(scan, folder / "drive/velodyne_points/data/0000000000.bin", share)
    return folder / "drive"


def argoverse(samples, folder, share):
    sweep = next(samples.glob("argoverse2/*/sensors/lidar/*.feather"))
    copied(sweep, folder / "log/sensors/lidar" / sweep.name, share)
    return folder / "log"


REAL = {
    "half of an Ouster's recording": (ouster, 0.5, "ouster: .*no whole turn, 1 broken"),
    "an Ouster's recording of no byte": (ouster, 0, r"ouster: .*a\.pcap with a\.json cannot be read"),
    "a third of a Velodyne's recording": (velodyne, 0.3, "velodyne: no whole turn"),
    "a Velodyne's recording of no byte": (velodyne, 0, r"velodyne: .*a\.pcap cannot be read"),
    "half of a sweep of nuScenes": (nuscenes, 0.5, "nuscenes: .*the file is cut off"),
    "a sweep of nuScenes of no byte": (nuscenes, 0, "nuscenes: .*has 0 bytes"),
    "half of a scan of KITTI": (kitti, 0.5, "kitti: .*(truncated|cut off)"),
    "a scan of KITTI of no byte": (kitti, 0, "kitti: .*is empty"),
    "half of a sweep of Argoverse": (argoverse, 0.5, "argoverse2: .*feather cannot be read .*cut off"),
    "a sweep of Argoverse of no byte": (argoverse, 0, "argoverse2: .*feather cannot be read"),
}
NEEDS = {ouster: "ouster.sdk", velodyne: "velodyne_decoder", argoverse: "pyarrow"}


@pytest.mark.parametrize("bad", REAL)
def test_real_recordings_that_are_cut_off_or_empty_are_told(samples, tmp_path, bad):
    make, share, told = REAL[bad]
    if make in NEEDS:
        pytest.importorskip(NEEDS[make], reason=f"{NEEDS[make]} is not installed")
    with pytest.raises(ValueError, match=rf"(?s){told}"):
        frames_of(make(samples, tmp_path, share), tmp_path / "out")


def test_packets_of_another_profile_are_told(samples, tmp_path):
    """An OS-1 of the legacy profile with the description of an OS-2 that sends another."""
    pytest.importorskip("ouster.sdk", reason="ouster-sdk is not installed")
    with pytest.raises(ValueError, match=r"not one packet of .* is of the sensor that a\.json describes \(OS-2-128"):
        frames_of(ouster(samples, tmp_path, 1.0, description="OS-2"), tmp_path / "out")


def test_what_ousters_library_says_in_several_lines_is_one(samples, tmp_path):
    pytest.importorskip("ouster.sdk", reason="ouster-sdk is not installed")
    log = ouster(samples, tmp_path, 1.0)
    log.with_suffix(".json").write_text("")
    with pytest.raises(ValueError, match=r"^[^\n]*cannot be read: [^\n]*; pass a \.pcap and the \.json of its sensor$"):
        frames_of(log, tmp_path / "out")


def test_an_ousters_recording_without_its_json_says_what_it_lacks(samples, tmp_path):
    pytest.importorskip("velodyne_decoder", reason="velodyne-decoder is not installed")
    log = ouster(samples, tmp_path, 1.0)
    log.with_suffix(".json").unlink()
    with pytest.raises(
        ValueError, match=r"an Ouster's \.pcap is read with the sensor's \.json, of the same name beside"
    ):
        frames_of(log, tmp_path / "out")


def test_a_velodynes_recording_without_packets_is_told(samples, tmp_path):
    pytest.importorskip("velodyne_decoder", reason="velodyne-decoder is not installed")
    path = velodyne(samples, tmp_path, 1.0)
    path.write_bytes(path.read_bytes()[:24])
    with pytest.raises(ValueError, match=r"velodyne: .*holds no packet of a Velodyne sensor"):
        frames_of(path, tmp_path / "out")


def test_a_sweep_of_argoverse_without_points_is_told(tmp_path):
    feather = pytest.importorskip("pyarrow.feather", reason="pyarrow is not installed")
    pa = pytest.importorskip("pyarrow")
    (tmp_path / "log/sensors/lidar").mkdir(parents=True)
    columns = {name: np.zeros(0, np.float32) for name in ("x", "y", "z", "intensity")}
    numbers = {"laser_number": np.zeros(0, np.uint8), "offset_ns": np.zeros(0, np.int32)}
    feather.write_feather(pa.table(columns | numbers), tmp_path / "log/sensors/lidar/315973157959879000.feather")
    with pytest.raises(ValueError, match=f"argoverse2: .*{NO_POINT}"):
        frames_of(tmp_path / "log", tmp_path / "out")
