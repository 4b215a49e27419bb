"""jaxsim: learn an automotive LiDAR from drives, simulate it, find what the simulation lacks.

data        frames of drives: KITTI, renderers, the embedded world
  |
prepare     camera and LiDAR aligned on the sensor's polar grid
  |
pairs       the training pairs, kept on disk
  |
train       one loop: intensity (pix2pix), detector (detect), depth  ->  runs
  |
simulate    the learned sensor of a run: frames and clouds  <-  effects: what light and electronics do
  |
  |---- evaluate    scores of runs, of frames, of detectors (metrics)
  |
discover    which effect is missing: find, name, add, show  ->  effects, back into simulate
  |
engines     the answer in other simulators' parameters
  |
report      pictures, tables, pages
  |
studies     the paper's: which inputs count, is simulated intensity worth training on

All stand on config (settings), frame.py (what travels), geometry (rays, cameras, rasters) and files. `cloud` has clouds
and their formats, `export` the trees of them that detectors train on, portable.py the network for other programs.
Commands are files of cli, effects files of effects/catalogue, data sets rows of data, settings fields of config. The
likelihood is stated in discover/model, all thresholds of a decision in discover/rules. CONTRIBUTING.md says in five
lines each where these are, and how to add one.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jaxsim.cloud import save_cloud
    from jaxsim.compilation import enable_compilation_cache
    from jaxsim.data import open_dataset
    from jaxsim.discover import Result, Verdict, discover_folders
    from jaxsim.simulate import LearnedSensor, load, simulate_frame

__all__ = [
    "LearnedSensor",
    "Result",
    "Verdict",
    "discover_folders",
    "enable_compilation_cache",
    "load",
    "open_dataset",
    "save_cloud",
    "simulate_frame",
]

HOMES = {
    "cloud": ("save_cloud",),
    "compilation": ("enable_compilation_cache",),
    "data": ("open_dataset",),
    "discover": ("Result", "Verdict", "discover_folders"),
    "simulate": ("LearnedSensor", "load", "simulate_frame"),
}
"""The public names of each package."""


def __getattr__(name: str) -> Any:
    # On demand: `import jaxsim` costs nothing, and parts whose packages are absent do not stop the others.
    for package, names in HOMES.items():
        if name in names:
            return getattr(importlib.import_module(f"jaxsim.{package}"), name)
    raise AttributeError(f"module 'jaxsim' has no attribute {name!r}; it has {', '.join(__all__)}")


def __dir__() -> list[str]:
    """The public names, which are not there before they are asked for."""
    return [*__all__]
