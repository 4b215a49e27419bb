"""Which settings a pair depends on."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from jaxsim.config import DataConfig, PrepareConfig

LABELS = {"semantic", "edges"}
"""Inputs that need class labels."""


def pair_settings(data: DataConfig, prepare: PrepareConfig) -> dict[str, Any]:
    """`data` and `prepare` as plain values, without what changes no pair: which frames are used, where pairs are
    kept, which channels the network sees and at what size. But a frame without labels is an error where labels are
    asked for, so `prepare.inputs` still says whether they were. A file of weights is named by its contents.

    Raises FileNotFoundError where it is missing.
    """
    bare = replace(data, train="", validation="", cache=Path(), root=data.root and data.root.resolve())
    labels = ("semantic",) if LABELS & {*prepare.inputs} else ()
    paired = replace(prepare, inputs=labels, network_size=(0, 0), classes=(), max_range_m=0.0)
    values = {
        "data": TypeAdapter(DataConfig).dump_python(bare, mode="json"),
        "prepare": TypeAdapter(PrepareConfig).dump_python(paired, mode="json"),
    }
    for name in ("denoise_weights", "depth_weights"):
        if (path := getattr(prepare, name)) is not None:
            values["prepare"][name] = _contents(path)
    return values


def _contents(path: Path) -> str:
    if not path.is_file():
        raise FileNotFoundError(f"prepare: no weights at {path}; jaxsim convert writes them")
    return f"SHA-256 {hashlib.sha256(path.read_bytes()).hexdigest()}"
