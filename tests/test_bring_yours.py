"""The commands of docs/bring-yours.md as they stand there: run on files of the true formats, or said where they are."""

import json
import re
import shlex
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from jaxsim.cli import main
from jaxsim.data.polar_frames import open_polar_frames
from jaxsim.effects.chain import SensorModel
from tests.data.logs.conftest import room
from tests.data.logs.made_logs import (
    carla_buffer,
    las,
    mcap,
    message,
    osi_mcap,
    osi_trace,
    pcd,
    ros2_bag,
    sensor_view,
    write_image,
)
from tests.discover.made_gate import sides
from tests.discover.made_watch import day
from tests.pages import CODE

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs/bring-yours.md"
ELSEWHERE = {
    "jaxsim discover --measured measured --simulated simulated --out answer": "tests/discover/test_gate.py",
    "jaxsim discover --measured measured --simulated simulated --gate whole.json --out answer": (
        "tests/discover/test_gate.py"
    ),
}
"""Commands that need streets to tell effects apart in, and where they are run as they stand."""
MAKERS = {
    "ouster": {"intensity_quantization", "oren_nayar", "near_range_overlap"},
    "argoverse": {"intensity_quantization"},
    "kitti": {"intensity_quantization", "beam_gain", "incidence_cosine", "atmospheric_extinction"},
}
"""What the page says that Lambert's law lacks of each."""
MINUTES = {
    **{f"jaxsim discover --measured {maker} --lambert --out {maker}_answer": maker for maker in MAKERS},
    "jaxsim frames KITTI_RAW --out kitti": "kitti",
    "jaxsim convert generator embedded --to onnx --out generator.onnx": "onnxruntime",
    "jaxsim convert generator embedded --to stablehlo --out generator.stablehlo": "flatbuffers",
}
"""Commands that take minutes: whole answers, and a network that is compiled; which sensor, or which module."""


def page_commands() -> list[tuple[str, str]]:
    """Section and command, each `jaxsim` line of the page's blocks once a section."""
    found: dict[tuple[str, str], None] = {}
    for section in re.split(r"^## ", PAGE.read_text(), flags=re.MULTILINE):
        title = section.splitlines()[0].lstrip("# ")
        for block in [body for language, body in CODE.findall(section) if not language]:
            lines = block.replace("\\\n", " ").splitlines()
            found |= dict.fromkeys((title, " ".join(line.split())) for line in lines if line.startswith("jaxsim "))
    return list(found)


COMMANDS = page_commands()
RUN = [(title, command) for title, command in COMMANDS if command not in ELSEWHERE | MINUTES]


def ouster(samples: Path) -> None:
    source = next((samples / "ouster").glob("OS-1*.pcap"))
    Path("recording.pcap").symlink_to(source)
    Path("recording.json").symlink_to(source.with_suffix(".json"))
    sdk = pytest.importorskip("ouster.sdk", reason="ouster-sdk is not installed")
    turns = [turn for turns in sdk.open_source(str(source)) for turn in turns]
    writer = pytest.importorskip("ouster.sdk.osf").Writer("recording.osf", [turns[0].sensor_info])
    for turn in turns:
        writer.save(0, turn)
    writer.close()


def two_makers(samples: Path) -> None:
    source = next((samples / "ouster").glob("OS-2*.pcap"))
    for suffix in (".pcap", ".json"):
        Path("OS-2-128").with_suffix(suffix).symlink_to(source.with_suffix(suffix))
    log = next((samples / "argoverse2").iterdir())
    Path(log.name).symlink_to(log)


def kitti(samples: Path) -> None:
    subprocess.run([sys.executable, samples / "kitti_drives/unpack.py", "KITTI_RAW"], check=True)


def drives(samples: Path) -> None:
    for name, folder in (("2011_09_26", "kitti_raw/2011_09_26"), ("samples", "nuscenes/samples")):
        Path(name).symlink_to(samples / folder)
    log = next((samples / "argoverse2").iterdir())
    Path(log.name).symlink_to(log)


def clouds(samples: Path) -> None:
    pytest.importorskip("lazrs", reason="lazrs is not installed")
    Path("scans").mkdir()
    pcd(Path("scans/000.pcd"), room(), "binary_compressed")
    las(Path("scan.laz"), many_lines())


def many_lines(lines: int = 64) -> dict[str, np.ndarray]:
    """A scan of 64 lines without ring, in a room of its own."""
    azimuth, elevation = np.meshgrid(np.deg2rad(np.arange(0.5, 360, 2)), np.deg2rad(np.linspace(10, -20, lines)))
    level = 10 * np.cos(elevation)
    xyz = level * np.cos(azimuth), level * np.sin(azimuth), 10 * np.sin(elevation)
    fields = {axis: value.astype("f4").ravel() for axis, value in zip("xyz", xyz, strict=True)}
    ring = np.broadcast_to(np.arange(lines)[::-1, None], azimuth.shape).astype("u2").ravel()
    return fields | {
        "intensity": np.full(ring.size, 77, "u1"),
        "ring": ring,
        "t": np.linspace(0, 1e8, ring.size).astype("u4"),
    }


def images(samples: Path) -> None:
    write_image(Path("range_images/000.npz"))


def carla(samples: Path) -> None:
    Path("sim").mkdir()
    carla_buffer(Path("sim"), room(), semantic=True)


def osi(samples: Path) -> None:
    osi_trace(Path("drive_sv_3.osi"), sensor_view(room()))
    osi_mcap(Path("trace.mcap"), room())


def frames(samples: Path) -> None:
    """Polar frames of a small drive."""
    Path("drive").mkdir()
    pcd(Path("drive/000.pcd"), room(), "binary")
    main(["frames", "drive", "--out", "measured"])


def answer(samples: Path) -> None:
    Path("answer").mkdir()
    SensorModel((("atmospheric_extinction", {"coefficient_per_m": 0.003}),)).save(Path("answer/sensor.json"))


def gate(samples: Path) -> None:
    """The page's own gate of distances."""
    sides(Path())
    Path("gate.json").write_text(next(body for language, body in CODE.findall(PAGE.read_text()) if language == "json"))


def days(samples: Path) -> None:
    for seed, name in enumerate(("monday", "tuesday", "wednesday")):
        day(Path(name), seed)


MAKE: dict[str, Callable[[Path], None]] = {
    "Two makers": two_makers,
    "Ouster": ouster,
    "Velodyne": lambda samples: Path("recording.pcap").symlink_to(samples / "velodyne_vlp16/my.pcap"),
    "KITTI, nuScenes, Argoverse 2": drives,
    "PCD, PLY, LAS": clouds,
    "Range images": images,
    "CARLA": carla,
    "ASAM OSI": osi,
    "Back to clouds": frames,
    "The answer in your engine's words": answer,
    "A gate for every commit": gate,
    "A sensor over days": days,
}


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(("title", "command"), RUN, ids=[command for _, command in RUN])
def test_the_pages_command_runs(here, samples, title, command):
    words = shlex.split(command)[1:]
    if "rrd" in words:
        pytest.importorskip("rerun", reason="rerun-sdk is not installed")
    if title == PAGE.read_text().splitlines()[0].lstrip("# "):
        title = "Ouster" if words[0] == "frames" else "The answer in your engine's words"
    if title == "ROS 2 bags and MCAP":
        if "bag" in words:
            ros2_bag(here / "bag", room(), topic="/lidar_top/points")
        else:
            mcap(Path("drive.mcap"), [message(room())])
    else:
        MAKE[title](samples)
    ended = 0
    try:
        main(words)
    except SystemExit as stop:
        ended = stop.code or 0
    # A gate and a watch tell by their status what they found; whatever it is, they have looked.
    assert ended in ((0, 1) if words[0] in ("watch", "discover") else (0,)), ended
    out = Path(words[words.index("--out") + 1]) if "--out" in words else None
    if out is not None:
        assert out.exists()
    if words[0] == "frames" and "--to" not in words:
        image, _ = open_polar_frames(out).read(open_polar_frames(out).names[0])
        assert np.asarray(image.valid).mean() > 0.2


@pytest.mark.slow
@pytest.mark.parametrize("maker", MAKERS)
def test_from_a_raw_log_to_a_verdict_by_two_commands(here, samples, standard_promotion, maker):
    (kitti if maker == "kitti" else two_makers)(samples)
    commands = [command for title, command in COMMANDS if title == "Two makers" and maker in command]
    assert [command.split()[1] for command in commands] == ["frames", "discover"]
    for command in commands:
        main(shlex.split(command)[1:])
    verdict = json.loads(Path(f"{maker}_answer/verdict.json").read_text())
    said = [{effect["name"], *effect["look_alikes"]} for effect in verdict["effects"]]
    # Of two that the answer cannot tell apart either may come first.
    assert len(said) == len(MAKERS[maker])
    assert all(any(name in one for one in said) for name in MAKERS[maker])


@pytest.mark.slow
@pytest.mark.parametrize("form", ["onnx", "stablehlo"])
def test_the_travelling_network_becomes_a_file(here, capsys, form):
    command = next(command for command in MINUTES if f"--to {form}" in command)
    pytest.importorskip(MINUTES[command])
    main(shlex.split(command)[1:])
    assert Path(f"generator.{form}").stat().st_size > 1e6
    told = float(capsys.readouterr().out.split("largest difference to the run's own answer ")[1].split(";")[0])
    assert told < 1e-4


def test_what_is_run_elsewhere_is_on_the_page_and_stands_there():
    on_page = {command for _, command in COMMANDS}
    assert {*ELSEWHERE, *MINUTES} <= on_page
    assert len(RUN) > 20
    for command, place in ELSEWHERE.items():
        assert command.removeprefix("jaxsim ") in (ROOT / place).read_text(), place


def test_every_section_with_commands_has_files_made_for_it():
    known = {*MAKE, "ROS 2 bags and MCAP", "The network for another program"}
    first = PAGE.read_text().splitlines()[0].lstrip("# ")
    assert {title for title, _ in COMMANDS} - {first} <= known
