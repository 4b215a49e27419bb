"""Experiments by name or by file: those of configs/, a user's own, and the config.json of a run.

A file of configs/ holds one value, `experiment` (for `jaxsim train`) or `loop` (for `jaxsim real2sim2real`), and a
docstring that says what it takes and scored. The folder lies beside the package in a checkout and inside it when
installed, and is loaded by its path, so that experiments are the same from anywhere.
"""

from __future__ import annotations

import importlib
import importlib.util
import sys
from functools import cache
from pathlib import Path
from types import ModuleType

from jaxsim.config import LoopConfig
from jaxsim.files import guess, parse_settings, placed, read_json
from jaxsim.runs.kinds import AnyExperiment, kind_in

PACKAGE = Path(__file__).parents[1]
CONFIGS = next(folder for folder in (PACKAGE / "configs", PACKAGE.parent / "configs") if folder.is_dir())
"""The folder of experiments: installed, or of the checkout."""


@cache
def experiment_names(of: str = "experiment") -> tuple[str, ...]:
    """Names of the experiments that `jaxsim train` trains; of a `loop`, of the settings of `jaxsim real2sim2real`."""
    return tuple(name for name in _names() if hasattr(_module(name), of))


def load_experiment(name: str) -> tuple[AnyExperiment, str]:
    """The experiment of a name of configs/, a file NAME.py like them, or a run's config.json; and its docstring.

    Raises ValueError for a name that is unknown, and for a file that holds no experiment.
    """
    if name.endswith(".json"):
        return read_experiment(Path(name)), f"Settings of {name}."
    if not name.endswith(".py") and name not in _names():
        raise ValueError(_unknown("experiment", name, experiment_names()))
    module = _module(name)
    if hasattr(module, "loop"):
        raise ValueError(f"{name} is not for `jaxsim train`: jaxsim real2sim2real --config {name}")
    if not isinstance(getattr(module, "experiment", None), AnyExperiment):
        raise ValueError(f"{name} holds no experiment; write `experiment = ...` as in {CONFIGS / 'synthetic.py'}")
    return module.experiment, (module.__doc__ or "").strip()


def load_loop(name: str) -> tuple[LoopConfig, str]:
    """The Real2Sim2Real of a name of configs/, a file like them, or an earlier one's loop.json; and its docstring.

    Raises ValueError for a name that is unknown, and for a file that holds no such settings.
    """
    loops = experiment_names("loop")
    known = ", ".join(loops)
    if name.endswith(".json"):
        if not Path(name).is_file():
            raise ValueError(f"real2sim2real: no file {name}; name one of {known}, or a loop.json")
        with placed(f"real2sim2real: {name} is no loop.json of this version"):
            return parse_settings(LoopConfig, read_json(name, by="real2sim2real")), f"settings of {name}"
    if not name.endswith(".py") and name not in loops:
        raise ValueError(_unknown("Real2Sim2Real", name, loops))
    module = _module(name)
    if not isinstance(getattr(module, "loop", None), LoopConfig):
        raise ValueError(f"{name} holds no Real2Sim2Real; write `loop = ...` as in {CONFIGS / 'real2sim2real.py'}")
    return module.loop, (module.__doc__ or "").strip()


def read_experiment(path: Path) -> AnyExperiment:
    """The experiment in a run's config.json. Raises ValueError where the file holds none of this version."""
    if not path.is_file():
        raise ValueError(
            f"no file {path}; give an experiment's name (`jaxsim train --help` lists them), or the config.json of a run"
        )
    with placed(f"{path} is not the config.json of a run of this version"):
        content = read_json(path, by="train")
        return parse_settings(kind_in(content).experiment, content.get("experiment", content))


def _unknown(what: str, name: str, known: tuple[str, ...]) -> str:
    return f"no {what} {name!r}{guess(name, known)} There are {', '.join(known)}"


def _names() -> list[str]:
    return sorted(path.stem for path in CONFIGS.glob("*.py") if path.stem != "__init__")


def _module(name: str) -> ModuleType:
    """The module of a name of configs/, or of a file; either may import from `configs`."""
    known = sys.modules.get("configs")
    if known is None or not {str(CONFIGS)} & {*getattr(known, "__path__", ())}:
        _run("configs", CONFIGS / "__init__.py")
    if not name.endswith(".py"):
        return importlib.import_module(f"configs.{name}")
    if not Path(name).is_file():
        raise ValueError(
            f"no file {name}; give one like {CONFIGS / 'synthetic.py'}, or a name: {', '.join(experiment_names())}"
        )
    return _run(f"configs.own_{Path(name).stem}", Path(name))


def _run(name: str, path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module
