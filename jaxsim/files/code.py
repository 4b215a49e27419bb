"""Code that files depend on: packages that only some need, and the sources that made them."""

from __future__ import annotations

import hashlib
import importlib
from pathlib import Path
from typing import Any


def need(module: str, extra: str, *, by: str) -> Any:
    """A module of an extra. Raises ModuleNotFoundError that says what to install."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise ModuleNotFoundError(
            f"{by}: this needs {module.split('.')[0]}; pip install 'jaxsim-lidar[{extra}]'"
        ) from error


def loaded(point: Any, *, by: str, what: str) -> Any:
    """What an installed package's entry point names; `what` it is says the error. Raises ValueError for whatever the
    package's own code raises."""
    # Of no type: where importlib_metadata is installed too, the standard library gives entry points of its class.
    try:
        return point.load()
    except Exception as error:
        raise ValueError(
            f"{by}: {what} cannot be loaded ({type(error).__name__}: {error}); mend or uninstall the package"
        ) from error


def _sources(room: Path) -> list[Path]:
    return sorted(file for file in room.rglob("*") if file.suffix in (".py", ".cc", ".h"))


def making(settings: str, *parts: str) -> str:
    """Sixteen hexadecimal digits for what is made with these settings by the code of these rooms and files of the
    package: what was made by other code, or with other settings, is kept elsewhere."""
    root = Path(__file__).parents[1]
    files = [file for part in parts for file in (_sources(root / part) or [root / part])]
    code = b"".join(file.read_bytes() for file in files)
    return hashlib.sha256(settings.encode() + code).hexdigest()[:16]
