"""Packages that only some inputs and outputs need."""

from __future__ import annotations

import importlib
from typing import Any


def need(module: str, extra: str, *, by: str) -> Any:
    """A module of an extra. Raises ModuleNotFoundError that says what to install."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise ModuleNotFoundError(
            f"{by}: this needs {module.split('.')[0]}; pip install 'jaxsim-lidar[{extra}]'"
        ) from error
