"""jaxsim: learn an automotive LiDAR from drives, simulate it, find what the simulation lacks.

data        frames of drives (KITTI, the embedded world)
  | prepare     camera and LiDAR aligned on the sensor's polar grid
  | effects     what light and electronics do: the catalogue, and sensor models made of it
  | pix2pix     the network that learns intensity
  | simulate    runs, the learned sensor, its scores
cloud       point clouds in the formats that tools open
report      pictures and tables
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jaxsim.cloud import save_cloud
    from jaxsim.data import open_dataset
    from jaxsim.simulate.sensor import LearnedSensor, load

__all__ = ["LearnedSensor", "load", "open_dataset", "save_cloud"]

HOMES = {"LearnedSensor": "simulate", "load": "simulate", "open_dataset": "data", "save_cloud": "cloud"}


def __getattr__(name: str) -> Any:
    # On demand: `import jaxsim` costs nothing, and parts whose packages are absent do not stop the others.
    if name in HOMES:
        return getattr(importlib.import_module(f"jaxsim.{HOMES[name]}"), name)
    raise AttributeError(f"module 'jaxsim' has no attribute {name!r}; it has {', '.join(__all__)}")
