"""What a bug report needs to know of a machine, and whether a sample run works on it (`jaxsim doctor`)."""

from __future__ import annotations

import os
import platform
import re
import sys
import time
from importlib.metadata import PackageNotFoundError, distribution, version
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from jaxsim.compilation import cache_folder

DISTRIBUTION = "jaxsim-lidar"
SAMPLE_FRAME = 1920
"""A street of the embedded world that the packaged sensor has not learned from."""
PROGRAM_OF = {
    "opencv-python-headless": "cv2",
    "orbax-checkpoint": "orbax",
    "scikit-image": "skimage",
    "scikit-learn": "sklearn",
    "ouster-sdk": "ouster",
    "import-linter": "importlinter",
    "pytest-xdist": "xdist",
}
"""Top module of each package whose name is another."""
Lines = list[tuple[str, str]]
"""Names, and what is told of each."""


def facts() -> Lines:
    """Versions, devices, the cache and the extras that are installed; nothing of them names a user's data."""
    needs, extras = requirements()
    lines = [*machine(), *packages([*needs, "jaxlib"]), *devices(), *native_form(), *environment_settings(), *cache()]
    return [*lines, *installed_extras(extras)]


def check_needs() -> None:
    """Raises ModuleNotFoundError where a package is missing that jaxsim needs."""
    missing = [name for name in requirements()[0] if version_of(name) is None]
    if missing:
        raise ModuleNotFoundError(f"doctor: {', '.join(missing)} missing; pip install '{DISTRIBUTION}' brings them")


def requirements(package: str = DISTRIBUTION) -> tuple[list[str], dict[str, list[str]]]:
    """Packages that a package needs, and those of each of its extras, by the installed distribution's own metadata.

    A package that is asked for with an extra of its own (`jax[cuda13]`) brings what that extra holds.
    """
    needs: list[str] = []
    extras: dict[str, list[str]] = {}
    for line in distribution(package).requires or ():
        name = re.match(r"([A-Za-z0-9._-]+)(?:\[([^]]+)\])?", line)
        extra = re.search(r"""extra == ['"]([^'"]+)['"]""", line)
        if name:
            required = extras.setdefault(extra[1], []) if extra else needs
            required.append(name[1])
            if name[2] and version_of(name[1]):
                theirs = requirements(name[1])[1]
                required += [one for asked in name[2].split(",") for one in theirs.get(asked.strip(), ())]
    return needs, extras


def version_of(package: str) -> str | None:
    """The installed version of a package; None where there is none."""
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def machine() -> Lines:
    """Versions of jaxsim and Python, the system, and what of a machine it runs on."""
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30 if hasattr(os, "sysconf") else 0.0
    return [
        ("jaxsim", version_of(DISTRIBUTION) or "not installed"),
        ("python", f"{platform.python_version()} ({sys.implementation.name})"),
        ("system", f"{platform.system()} {platform.release()}, {platform.machine()}"),
        ("machine", f"{os.cpu_count()} processors, {memory:.0f} GiB"),
    ]


def packages(needs: list[str]) -> Lines:
    """The packages that jaxsim needs, with their versions."""
    return [("packages", ", ".join(f"{name} {version_of(name) or 'MISSING'}" for name in sorted(needs)))]


def devices() -> Lines:
    """What JAX computes on; a backend that does not start is told with its reason."""
    import jax  # waits until it is asked for: an import that fails is a finding too

    try:
        devices_here = [f"{one.platform} {one.device_kind}" for one in jax.devices()]
    except (RuntimeError, AssertionError) as error:  # JAX asserts, without a word, that a platform has its plugin
        reason = (str(error).strip() or "its plugin is missing").splitlines()[0]
        return [("devices", f"none: JAX starts no device ({reason}); JAX_PLATFORMS=cpu needs none")]
    return [("devices", ", ".join(devices_here))]


def native_form() -> Lines:
    """Which form takes the place of what XLA does slowly on a CPU; it is compiled for that if it has not been."""
    from jaxsim.native.build import form  # waits, as above

    try:
        return [("native", form().replace(os.path.expanduser("~"), "~", 1))]
    except (RuntimeError, AssertionError):  # no device starts, which `devices` has told
        return [("native", "none: no device")]


def environment_settings() -> Lines:
    """What the environment sets of JAX and of jaxsim; of most use where no device starts."""
    given = [name for name in os.environ if name.startswith(("JAX_", "XLA_", "CUDA_VISIBLE", "JAXSIM_"))]
    return [("settings", ", ".join(f"{name}={os.environ[name]}" for name in sorted(given)) or "none")]


def cache() -> Lines:
    """Where compiled programs are kept, and how many."""
    asked = os.environ.get("JAX_COMPILATION_CACHE_DIR")
    folder = Path(asked) if asked else cache_folder() if asked is None else None
    if folder is None:
        return [("cache", "off" if asked == "" else "none: no folder that this user may write to")]
    files = [path for path in folder.rglob("*") if path.is_file()] if folder.is_dir() else []
    size = sum(path.stat().st_size for path in files) / 2**20
    shown = str(folder).replace(os.path.expanduser("~"), "~", 1)
    return [("cache", f"{shown}: {len(files)} files, {size:.0f} MiB")]


def installed_extras(extras: dict[str, list[str]]) -> Lines:
    """Each extra, and what it lacks."""
    lines = []
    for extra, names in sorted(extras.items()):
        # The module counts too: another package may bring it (opencv-python has the cv2 of opencv-python-headless).
        lacks = [name for name in names if version_of(name) is None and find_spec(module_of(name)) is None]
        lines.append(extra if not lacks else f"{extra} (lacks {', '.join(lacks)})")
    return [("extras", "; ".join(lines) or "none")]


def module_of(package: str) -> str:
    """The top module of a package."""
    return PROGRAM_OF.get(package, package.replace("-", "_"))


def sample_run() -> str:
    """Simulates a frame of the embedded world with the packaged sensor. Raises ValueError for a cloud that cannot be
    right."""
    begun = time.monotonic()
    import jaxsim  # waits: it loads all of the library

    learned = jaxsim.load("embedded")
    view = jaxsim.open_dataset("synthetic")[SAMPLE_FRAME].camera
    cloud = learned.simulate(rgb=view.rgb, depth_m=view.depth_m, semantic=view.semantic, instance=view.instance)
    valid = np.asarray(cloud.valid)
    if not valid.any() or not np.isfinite(np.asarray(cloud.xyz_m)[valid]).all():
        raise ValueError(f"doctor: the sample cloud has {valid.sum()} points, or some that are not finite")
    return f"{valid.sum()} points simulated in {time.monotonic() - begun:.1f} s"
