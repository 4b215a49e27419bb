"""The sensor that travels with the package: a small network, trained on the embedded world.

`card.md` beside this file says how it was trained and what it scored; `SHA256SUMS` tells a damaged installation from a
whole one. `python -m jaxsim.simulate.embedded.pack RUN` makes these files from a run's folder.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import jax

from jaxsim.files import sha256_of
from jaxsim.pix2pix import state_shapes
from jaxsim.prepare import input_channels
from jaxsim.runs.kinds import Run
from jaxsim.runs.run import load_run
from jaxsim.weights import checked_arrays, read_state_dict

NAME = "embedded"
FOLDER = Path(__file__).parent
FILES = ("config.json", "generator.npz", "grain.json")
SUMS_FILE = "SHA256SUMS"
Tree = Any


def is_embedded(folder: Path | str) -> bool:
    """Whether a name asks for this sensor: it is `embedded`, and no run lies in a folder of that name here."""
    return Path(folder) == Path(NAME) and not (Path(folder) / "config.json").is_file()


def folder_of(run: Path) -> Path:
    """Where the files of a run lie: in its folder, and those of `embedded` in the package."""
    return FOLDER if is_embedded(run) else run


def read_embedded(folder: Path = FOLDER) -> tuple[Run, Tree]:
    """The run and the parameters of its generator.

    Raises ValueError where a file is missing, or is not the one that was packaged.
    """
    check(folder)
    run = load_run(folder)
    paths, structure = jax.tree.flatten_with_path(shapes_of(run))
    names = [name_of(path) for path, _ in paths]
    shapes = {name: leaf.shape for name, (_, leaf) in zip(names, paths, strict=True)}
    arrays = checked_arrays(read_state_dict(folder / "generator.npz"), shapes)
    return run, jax.device_put(jax.tree.unflatten(structure, [arrays[name] for name in names]))


def check(folder: Path) -> None:
    """Raises ValueError where a file is missing or differs from its SHA-256."""
    again = "the installation is damaged; install jaxsim-lidar again (pip install --force-reinstall --no-deps ...)"
    missing = [name for name in (*FILES, SUMS_FILE) if not (folder / name).is_file()]
    if missing:
        raise ValueError(f"embedded sensor: {', '.join(missing)} not in {folder}; {again}")
    sums = (folder / SUMS_FILE).read_text().splitlines()
    for name in FILES:
        if f"{sha256_of(folder / name)}  {name}" not in sums:
            raise ValueError(f"embedded sensor: {folder / name} is not the file that was packaged; {again}")


def shapes_of(run: Run) -> Tree:
    """Shapes and dtypes of the generator that a run keeps."""
    return state_shapes(run.experiment, input_channels(run.experiment.prepare)).ema


def name_of(path: Any) -> str:
    """Under which an array of the generator is stored: its place in the tree."""
    return jax.tree_util.keystr(path, simple=True, separator="/")
