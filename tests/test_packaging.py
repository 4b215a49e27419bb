"""The wheel, built and installed outside any checkout, does what the README says.

The quick form builds it, looks into it and tries what takes seconds; the slow form tries every command.
"""

import importlib.util
import os
import re
import shutil
import site
import subprocess
import sys
import sysconfig
import tomllib
import venv
import zipfile
from email import message_from_bytes
from pathlib import Path

import numpy as np
import pytest
import yaml

from jaxsim.data.polar_frames import write_frame, write_grid
from jaxsim.frame import PolarGrid, PolarImage
from jaxsim.native.build import COMPILERS
from tests.programs import PATIENCE_S, TINY

ROOT = Path(__file__).parents[1]
MOST_BYTES = 8_000_000
FRAMES = ["--{0}.train=0,8", "--{0}.validation=16"]
LOOP = [
    "--kinds=simulated_grid",
    *(flag.format(data) for data in ("intensity.data", "detector.data", "synthetic") for flag in FRAMES),
    "--intensity.prepare.columns=64", "--intensity.prepare.network-size", "64", "128",
    "--intensity.generator.filters=4", "--intensity.generator.blocks=1", "--intensity.generator.downsamples=1",
    "--intensity.generator.enhancers=0", "--intensity.discriminator.filters=4", "--intensity.discriminator.scales=1",
    "--intensity.discriminator.layers=1", "--intensity.optim.steps=2", "--intensity.optim.batch=2",
    "--detector.optim.epochs=1", "--detector.voxels.max-voxels-train=2000", "--detector.voxels.max-voxels=2000",
    "--detector.augment.sampled=0", "--detector.detector.train-proposals.after=16", "--detector.detector.roi.rois=8",
    "--detector.detector.roi.grid=3", "--detector.detector.backbone.widths", "4", "4", "4", "4",
    "--detector.detector.backbone.out=4",
]  # fmt: skip
"""Flags of a loop of two steps of a sensor and one epoch of detectors, on three frames a side."""
NO_REGISTRY = ("No matching distribution", "Could not find a version", "Connection", "Temporary failure", "Network")


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> Path:
    """The wheel of this checkout; skips where the build backend is neither installed nor to be had."""
    folder = tmp_path_factory.mktemp("wheel")
    at_hand = ["--no-build-isolation"] if importlib.util.find_spec("hatchling") else []
    command = [sys.executable, "-m", "pip", "wheel", "--no-deps", *at_hand, "--wheel-dir", str(folder), str(ROOT)]
    result = subprocess.run(command, text=True, capture_output=True, timeout=PATIENCE_S)
    if result.returncode and any(words in result.stdout + result.stderr for words in NO_REGISTRY):
        pytest.skip(f"hatchling is not installed and no registry has it: {result.stderr.strip().splitlines()[-1]}")
    assert result.returncode == 0, result.stdout + result.stderr
    (path,) = folder.glob("*.whl")
    return path


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory) -> Path:
    """The folder of programs of an environment that holds the wheel, and this environment's packages but for jaxsim."""
    folder = tmp_path_factory.mktemp("environment")
    venv.create(folder, symlinks=True)
    programs = folder / "bin"
    install = [sys.executable, "-m", "pip", "--python", str(programs / "python"), "install", "--no-deps", "--no-index"]
    subprocess.run([*install, str(wheel)], check=True, capture_output=True, timeout=PATIENCE_S)
    # Folders that a .pth names join the path, but .pth files in them, as that of an editable jaxsim, are not read.
    packages = {sysconfig.get_path("purelib"), sysconfig.get_path("platlib"), *site.getsitepackages()}
    places = {"base": str(folder), "platbase": str(folder)}
    (Path(sysconfig.get_path("purelib", "venv", places)) / "dependencies.pth").write_text("\n".join(sorted(packages)))
    return programs


@pytest.fixture(scope="module")
def work(tmp_path_factory) -> Path:
    """A folder outside any checkout."""
    return tmp_path_factory.mktemp("work")


def run(programs: Path, work: Path, program: str, *arguments: str, **settings: str) -> str:
    """What a program of the new environment prints, with these settings in its environment.

    XLA's flags are those of the tests' own process, which has compiled and kept most of the same programs.
    """
    env = {key: value for key, value in os.environ.items() if key not in ("PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV")}
    result = subprocess.run(
        [str(programs / program), *arguments],
        cwd=work,
        env={**env, "JAX_PLATFORMS": "cpu", **settings},
        text=True,
        capture_output=True,
        timeout=PATIENCE_S,
    )
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


def test_the_wheel_holds_experiments_sensor_types_and_licence_and_no_more_than_it_should(wheel):
    assert wheel.stat().st_size < MOST_BYTES
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
        (metadata,) = (name for name in names if name.endswith(".dist-info/METADATA"))
        about = message_from_bytes(archive.read(metadata))
    for needed in ("config.json", "generator.npz", "SHA256SUMS", "card.md"):
        assert f"jaxsim/simulate/embedded/{needed}" in names
    assert "jaxsim/py.typed" in names
    assert {f"jaxsim/native/{path.name}" for path in (ROOT / "jaxsim" / "native").glob("*.[ch]*")} < names
    assert wheel.name.endswith("-py3-none-any.whl")  # what is compiled is compiled where it is used
    for template in ("page.html", "page.css", "parts.html", "cloud.js", "viewer.js"):
        assert f"jaxsim/report/templates/{template}" in names
    for experiment in ("synthetic", "demo", "embedded", "kitti_raw", "real2sim2real", "voxel_rcnn_small"):
        assert f"jaxsim/configs/{experiment}.py" in names
    assert {name.split("/")[0] for name in names} == {"jaxsim", metadata.split("/")[0]}
    assert any(name.endswith("LICENSE") for name in names)
    assert about["Name"] == "jaxsim-lidar"
    assert about["License-Expression"] == "Apache-2.0"


def test_the_version_is_one():
    """Of the package, of the newest changes, and of what is cited, with one date."""
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    newest = re.search(r"^## (\S+), (\S+)$", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert newest
    assert newest.groups() == (version, str(cited["date-released"]))
    assert cited["version"] == version


def test_the_container_is_given_all_that_the_wheel_is_built_of():
    steps = (ROOT / "Dockerfile").read_text()
    copied = {one for line in re.findall(r"^COPY (?!--)(.+) \S+$", steps, re.MULTILINE) for one in line.split()}
    package = tomllib.loads((ROOT / "pyproject.toml").read_text())
    wheel = package["tool"]["hatch"]["build"]["targets"]["wheel"]
    needed = {package["project"]["readme"], *package["project"]["license-files"], "pyproject.toml", "constraints.txt"}
    assert needed | {*wheel["packages"], *wheel["force-include"]} == copied
    assert all((ROOT / name).exists() for name in copied)


def test_the_installed_package_is_tried_and_not_the_checkout(installed, work):
    file = run(installed, work, "python", "-c", "import jaxsim; print(jaxsim.__file__)").strip()
    assert Path(file).is_relative_to(installed.parent)
    assert "discover" in run(installed, work, "jaxsim", "--help")


@pytest.mark.long
def test_sparse_convolutions_are_compiled_where_there_is_a_compiler_and_work_without(installed, work):
    """Of what the wheel holds, in a process and a cache of its own."""
    code = "from jaxsim.native.build import form; print(form())"
    if any(map(shutil.which, COMPILERS)):
        assert run(installed, work, "python", "-c", code, XDG_CACHE_HOME=str(work)).startswith("C++ (")
    without = run(installed, work, "python", "-c", code, XDG_CACHE_HOME=str(work), PATH=str(installed), CXX="")
    assert without.startswith("XLA (no C++ compiler")


@pytest.mark.long
def test_the_readmes_lines_make_a_cloud_at_once(installed, work):
    block = re.search(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    assert block
    assert len([line for line in block[1].splitlines() if line.strip()]) <= 6
    run(installed, work, "python", "-c", block[1])
    header, points = (work / "scan.pcd").read_bytes().split(b"DATA", 1)
    assert int(re.search(rb"POINTS (\d+)", header)[1]) > 1000  # type: ignore[index]
    assert points


@pytest.mark.slow
def test_the_packaged_sensor_simulates_frames(installed, work):
    said = run(installed, work, "jaxsim", "simulate", "embedded", "--frames", "1920-1920", "--out", "simulated")
    assert "1 frame simulated" in said
    assert len(list((work / "simulated" / "clouds").glob("*.pcd"))) == 1


@pytest.mark.slow
def test_it_trains_and_scores_anywhere(installed, work):
    run(installed, work, "jaxsim", "train", "demo", *TINY)
    assert "network" in run(installed, work, "jaxsim", "eval", "runs/tiny")


@pytest.mark.slow
def test_it_goes_from_real_to_simulated_and_back(installed, work):
    run(installed, work, "jaxsim", "real2sim2real", "--out", "loop", *LOOP)
    assert "simulated_grid" in (work / "loop" / "real2sim2real.md").read_text()
    assert (work / "loop" / "real2sim2real.html").is_file()


@pytest.mark.slow
def test_it_discovers(installed, work):
    """Twelve drives whose ranges are 3 % too long."""
    random, rows, columns = np.random.default_rng(0), 16, 96
    azimuth = np.linspace(0.6, -0.6, columns).astype(np.float32)
    grid = PolarGrid(azimuth, np.linspace(0.0, -0.3, rows).astype(np.float32), np.zeros(rows, np.float32))
    for name in ("measured", "simulated"):
        write_grid(work / name, grid)
    for drive in range(12):
        range_m = random.uniform(5, 60, (rows, 1)) * random.uniform(0.95, 1.05, (1, columns))
        intensity = random.uniform(0.05, 0.9, (rows, columns)).astype(np.float32)
        for name, factor in (("measured", 1.03), ("simulated", 1.0)):
            noisy_m = (factor * range_m + random.normal(0, 0.02, range_m.shape)).astype(np.float32)
            write_frame(work / name, f"drive{drive}", PolarImage(noisy_m, intensity, noisy_m > 0))
    folders = ["--measured", "measured", "--simulated", "simulated"]
    run(installed, work, "jaxsim", "discover", *folders, "--out", "answer")
    assert {"verdict.json", "sensor.json", "report.html"} <= {path.name for path in (work / "answer").iterdir()}
