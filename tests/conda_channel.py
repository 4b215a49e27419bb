"""A conda channel of what runs here, so that the recipe is built and installed where conda-forge cannot be reached.

Its `python` is this interpreter; every other package holds the files of an installed distribution and asks for what
that distribution's metadata ask for.
"""

from __future__ import annotations

import sys
import sysconfig
from collections.abc import Iterable
from importlib.metadata import Distribution, distribution
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from rattler_build import FileEntry, assemble_package

PLATFORM = "linux-64"
CONDA_NAMES = {"opencv-python-headless": "py-opencv", "msgpack": "msgpack-python"}
TAG = f"python{sysconfig.get_python_version()}"
UNUSED = {"site-packages", "test", "__pycache__", "idlelib", "lib2to3", "ensurepip", "turtledemo", "tkinter"}


def make_channel(folder: Path, names: Iterable[str]) -> None:
    """Writes python and the named distributions, with all that they need, into the channel of a folder."""
    platform = folder / PLATFORM
    platform.mkdir(parents=True)
    _write(platform, "python", sys.version.split()[0], interpreter_files(), [])
    for name, dist in closure(names).items():
        depends = ["python", *sorted(_spec(one) for one in _needs(dist))]
        _write(platform, CONDA_NAMES.get(name, name), dist.version, _files(dist), depends)


def closure(names: Iterable[str]) -> dict[str, Distribution]:
    """The installed distributions of these names and of all that they need, by name."""
    found: dict[str, Distribution] = {}
    waiting = [canonicalize_name(name) for name in names]
    while waiting:
        name = waiting.pop()
        if name not in found:
            found[name] = distribution(name)
            waiting += [canonicalize_name(one.name) for one in _needs(found[name])]
    return dict(sorted(found.items()))


def interpreter_files() -> list[FileEntry]:
    """Its program under three names, its shared library where it has one, and the standard library."""
    base = Path(sys.base_prefix)
    files = [FileEntry.from_paths(base / "bin" / TAG, f"bin/{name}") for name in (TAG, "python3", "python")]
    files += [FileEntry.from_paths(file.resolve(), f"lib/{file.name}") for file in base.glob("lib/libpython*.so*")]
    for file in (base / "lib" / TAG).rglob("*"):
        inside = file.relative_to(base)
        if file.is_file() and not UNUSED & set(inside.parts) and not inside.parts[2].startswith("config-"):
            files.append(FileEntry.from_paths(file, inside))
    return files


def _needs(dist: Distribution, extras: Iterable[str] = ()) -> list[Requirement]:
    """What a distribution needs here, and what the extras that it asks of others bring: conda has no extras."""
    asked = ("", *extras)
    every = [Requirement(text) for text in dist.requires or ()]
    needs = [one for one in every if one.marker is None or any(one.marker.evaluate({"extra": e}) for e in asked)]
    return needs + [more for one in needs if one.extras for more in _needs(distribution(one.name), one.extras)]


def _spec(need: Requirement) -> str:
    name = canonicalize_name(need.name)
    return f"{CONDA_NAMES.get(name, name)} {need.specifier}".strip()


def _files(dist: Distribution) -> list[FileEntry]:
    """But for its programs, whose first line has this environment's path."""
    packages = Path("lib", TAG, "site-packages")
    inside = [file for file in dist.files or () if ".." not in file.parts and file.suffix != ".pyc"]
    return [FileEntry.from_paths(Path(str(file.locate())), packages / file) for file in inside]


def _write(folder: Path, name: str, version: str, files: list[FileEntry], depends: list[str]) -> None:
    plain = {"compression_level": 1, "detect_prefix": False}
    assemble_package(name, version.replace("-", "_"), PLATFORM, "0", folder, files=files, depends=depends, **plain)
