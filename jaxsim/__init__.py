"""jaxsim: learn an automotive LiDAR from drives, simulate it, find what the simulation lacks.

    data        frames of drives (KITTI, the embedded world)
      | prepare     camera and LiDAR aligned on the sensor's polar grid
      | pix2pix     the network that learns intensity
      | simulate    runs, the learned sensor, its scores
    cloud       point clouds in the formats that tools open
    report      pictures and tables
"""

from __future__ import annotations

from typing import Any

__all__ = ["LearnedSensor", "load", "open_dataset", "save_cloud"]


def __getattr__(name: str) -> Any:
    # On demand: `import jaxsim` costs nothing, and parts whose packages are absent do not stop the others.
    if name in ("LearnedSensor", "load"):
        from jaxsim import simulate

        return getattr(simulate, name)
    if name == "open_dataset":
        from jaxsim.data import open_dataset

        return open_dataset
    if name == "save_cloud":
        from jaxsim.cloud import save_cloud

        return save_cloud
    raise AttributeError(f"module 'jaxsim' has no attribute {name!r}")
