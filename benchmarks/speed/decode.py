"""Logs to arrays: what `jaxsim frames` takes of PointCloud2 in MCAP, of PCD and of Ouster's packets, against the peers.

`python benchmarks/speed/decode.py [DATA]`, from the repository's root; needs the extras ros, pcd and ouster. DATA holds
pandaset/ and ouster/ (by default $JAXSIM_SAMPLE_DATA). Both sides deliver the same columns, which is checked first. The
MCAP is PandaSet's scan, eight times, as `jaxsim frames --to mcap` writes it.
"""

import os
import sys
import tempfile
from pathlib import Path

os.environ.setdefault("JAX_PLATFORMS", "cpu")  # the peers have no other

import numpy as np
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from mcap_ros2.writer import Writer
from ouster.sdk import core
from ouster.sdk.open_source import open_source
from pypcd4 import PointCloud
from rosbags.typesys import Stores, get_typestore
from timing import interleave

from jaxsim.data.logs import LogOptions, source_for
from jaxsim.data.logs.files import read_pcd
from jaxsim.data.logs.gridding import infer_layout, to_sweep
from jaxsim.data.sweeps import read_pcap
from jaxsim.recordings import Stamped, write_mcap

DATA = Path(os.environ.get("JAXSIM_SAMPLE_DATA", Path(__file__).parents[2] / "shared" / "data"))
KIND = "sensor_msgs/msg/PointCloud2"
MESSAGES = 8
NAMES = ("x", "y", "z", "intensity", "ring")


def as_plain(data: bytes, step: int) -> np.ndarray:
    """The points of a message whose layout is known: the least that NumPy can do."""
    kinds = {"names": NAMES, "formats": ["<f4"] * 4 + ["<u2"], "offsets": [0, 4, 8, 12, 16], "itemsize": step}
    return np.frombuffer(data, np.dtype(kinds))


def columns(points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points, intensity and ring, each an array of its own."""
    xyz = np.stack([points[axis] for axis in "xyz"], axis=1)
    return xyz, np.ascontiguousarray(points["intensity"]), points["ring"].astype(np.int64)


def of_mcap(path: Path) -> None:
    """Reading all clouds of an MCAP."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    _, source = source_for(path)

    def ours() -> list[tuple[np.ndarray, ...]]:
        scans = [item.read() for item in source.items(path, LogOptions(full_scale=1.0))]
        return [(scan.xyz_m, scan.intensity, scan.ring) for scan in scans]

    def with_rosbags() -> list[tuple[np.ndarray, ...]]:
        with path.open("rb") as file:
            raws = [message.data for _, _, message in make_reader(file).iter_messages()]
        messages = [store.deserialize_cdr(raw, KIND) for raw in raws]
        return [columns(as_plain(m.data.tobytes(), m.point_step)) for m in messages]

    def with_mcap_ros2() -> list[tuple[np.ndarray, ...]]:
        with path.open("rb") as file:
            reader = make_reader(file, decoder_factories=[DecoderFactory()])
            return [columns(as_plain(bytes(m.data), m.point_step)) for *_, m in reader.iter_decoded_messages()]

    def with_pypcd4() -> list[tuple[np.ndarray, ...]]:
        with path.open("rb") as file:
            raws = [message.data for _, _, message in make_reader(file).iter_messages()]
        clouds = [PointCloud.from_msg(store.deserialize_cdr(raw, KIND)) for raw in raws]
        return [columns(cloud.pc_data) for cloud in clouds]

    peers = {"jaxsim": ours, "mcap + rosbags + NumPy": with_rosbags, "mcap-ros2 + NumPy": with_mcap_ros2}
    peers["mcap + pypcd4.from_msg"] = with_pypcd4
    same("MCAP", peers)
    interleave(f"MCAP: {MESSAGES} clouds to arrays", peers)


def of_pcd(path: Path) -> None:
    """Reading a compressed, organised PCD, and putting it onto its sensor's grid."""

    def ours() -> list[tuple[np.ndarray, ...]]:
        scan = read_pcd(path, LogOptions())
        return [(scan.xyz_m, scan.intensity)]

    def theirs() -> list[tuple[np.ndarray, ...]]:
        points = PointCloud.from_path(path).numpy(("x", "y", "z", "intensity")).astype(np.float32)
        return [(points[:, :3], points[:, 3])]

    same("PCD", {"jaxsim": ours, "pypcd4": theirs})
    interleave("PCD, binary_compressed, to arrays", {"jaxsim": ours, "pypcd4": theirs})
    scan = read_pcd(path, LogOptions())
    options = LogOptions()
    layout = infer_layout([scan], options, by="pcd")

    def plain() -> np.ndarray:
        """Rows are those of the file; columns by azimuth, the nearest wins: 64 x 1856 cells."""
        xyz, azimuth = scan.xyz_m, np.arctan2(scan.xyz_m[:, 1], scan.xyz_m[:, 0])
        height, width = scan.shape or (64, 1856)
        away = np.linalg.norm(xyz, axis=1)
        column = (np.nan_to_num(np.pi - azimuth) * width / (2 * np.pi)).astype(int) % width
        cell = np.repeat(np.arange(height), width) * width + column
        order = np.argsort(-np.where(away > 0, away, 0), kind="stable")
        image = np.zeros((height * width, 2), np.float32)
        image[cell[order]] = np.stack([away, scan.intensity], 1)[order]
        return image

    interleave(
        "PandaSet's scan to polar", {"jaxsim": lambda: to_sweep(scan, layout, options, by="pcd"), "NumPy": plain}
    )


def of_ouster(path: Path) -> None:
    """Reading a turn of an OS-2-128: ranges on their grid here; there points, by a table that is made beforehand."""
    meta = str(path.with_suffix(".json"))
    first = next(frame for frames in open_source(str(path), meta=[meta]) for frame in frames)
    table = core.XYZLutFloat(first.sensor_info, False)

    def ours() -> object:
        return next(iter(read_pcap(path)))

    def theirs() -> object:
        for frames in open_source(str(path), meta=[meta]):
            for frame in frames:
                if frame.complete():
                    range_mm = core.destagger(frame.sensor_info, frame.field("RANGE"))
                    return range_mm, core.destagger(frame.sensor_info, frame.field("REFLECTIVITY")), table(frame)
        raise SystemExit(f"{path} holds no whole turn")

    interleave("Ouster .pcap to a polar frame", {"jaxsim": ours, "ouster-sdk": theirs}, rounds=9)


def of_writing(table: np.ndarray, folder: Path) -> None:
    """Writing clouds as MCAP."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    text, _ = store.generate_msgdef(KIND, ros_version=2)
    fields = [
        {"name": name, "offset": int(table.dtype.fields[name][1]), "datatype": 4 if name == "ring" else 7, "count": 1}
        for name in table.dtype.names
    ]

    def ours() -> None:
        write_mcap(folder / "ours.mcap", [Stamped(k / 10, table) for k in range(MESSAGES)])

    def theirs() -> None:
        with (folder / "theirs.mcap").open("wb") as file, Writer(file) as writer:
            schema = writer.register_msgdef(KIND, text)
            for k in range(MESSAGES):
                message = {
                    "header": {"stamp": {"sec": 0, "nanosec": k * 100_000_000}, "frame_id": "lidar"},
                    "height": 1,
                    "width": len(table),
                    "fields": fields,
                    "is_bigendian": False,
                    "is_dense": True,
                    "point_step": table.itemsize,
                    "row_step": table.nbytes,
                    "data": table.tobytes(),
                }
                writer.write_message("/points", schema, message, log_time=k, publish_time=k)

    interleave(f"MCAP: {MESSAGES} clouds written", {"jaxsim": ours, "mcap-ros2": theirs}, rounds=9)


def same(what: str, peers: dict) -> None:
    """Ends the program where a peer does not deliver the same."""
    first, *others = (run() for run in peers.values())
    for name, other in zip(list(peers)[1:], others, strict=True):
        for a, b in zip(first, other, strict=True):
            if not all(np.array_equal(x, y, equal_nan=True) for x, y in zip(a, b, strict=False)):
                raise SystemExit(f"{what}: {name} does not deliver the same")


def main() -> None:
    data = Path(sys.argv[1]) if len(sys.argv) > 1 else DATA
    pcd = next((data / "pandaset").glob("*.pcd"))
    scan = read_pcd(pcd, LogOptions())
    kept = np.isfinite(scan.xyz_m).all(axis=1)
    table = np.zeros(int(kept.sum()), [(name, "<u2" if name == "ring" else "<f4") for name in (*NAMES, "time")])
    for k, axis in enumerate("xyz"):
        table[axis] = scan.xyz_m[kept, k]
    table["intensity"] = scan.intensity[kept] / 255
    table["ring"] = np.repeat(np.arange(64), 1856)[kept]
    print(f"PandaSet: {len(table)} points")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_mcap(folder / "drive.mcap", [Stamped(k / 10, table) for k in range(MESSAGES)])
        of_mcap(folder / "drive.mcap")
        of_writing(table, folder)
    of_pcd(pcd)
    of_ouster(next((data / "ouster").glob("OS-2*.pcap")))


if __name__ == "__main__":
    main()
