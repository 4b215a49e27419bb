"""Experiments: one file, one `experiment` value, and a docstring that says what it takes and scored."""

import importlib
import pkgutil

from jaxsim.config import DetectorExperiment, Experiment
from jaxsim.prepare.depth.penet.training import DepthExperiment

NAMES = sorted(module.name for module in pkgutil.iter_modules(__path__))


def load(name: str) -> tuple[Experiment | DetectorExperiment | DepthExperiment, str]:
    """The experiment of that name and its docstring. Raises ValueError for an unknown name."""
    if name not in NAMES:
        raise ValueError(f"no experiment {name!r} in configs/; there are {', '.join(NAMES)}")
    module = importlib.import_module(f"configs.{name}")
    return module.experiment, (module.__doc__ or "").strip()
