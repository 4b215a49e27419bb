"""Experiments: one file, one `experiment` value, and a docstring that says what it takes and scored."""

import importlib
import pkgutil

from jaxsim.config import DepthExperiment, DetectorExperiment, Experiment, LoopConfig

LOOPS = ("real2sim2real", "real2sim2real_kitti")
"""Of `jaxsim real2sim2real`; the others are for train.py."""
NAMES = sorted(module.name for module in pkgutil.iter_modules(__path__) if module.name not in LOOPS)


def load(name: str) -> tuple[Experiment | DetectorExperiment | DepthExperiment, str]:
    """The experiment of that name and its docstring. Raises ValueError for an unknown name."""
    if name in LOOPS:
        raise ValueError(f"{name} is not trained by train.py: jaxsim real2sim2real --config {name}")
    if name not in NAMES:
        raise ValueError(f"no experiment {name!r} in configs/; there are {', '.join(NAMES)}")
    module = importlib.import_module(f"configs.{name}")
    return module.experiment, (module.__doc__ or "").strip()


def load_loop(name: str) -> tuple[LoopConfig, str]:
    """The Real2Sim2Real of that name and its docstring. Raises ValueError for an unknown name."""
    if name not in LOOPS:
        raise ValueError(f"no Real2Sim2Real {name!r} in configs/; there are {', '.join(LOOPS)}")
    module = importlib.import_module(f"configs.{name}")
    return module.loop, (module.__doc__ or "").strip()
