"""Makes the packaged sensor's files: `python -m jaxsim.simulate.embedded.pack runs/embedded`."""

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import jax
import numpy as np

from jaxsim.config import RunConfig
from jaxsim.files import sha256_of
from jaxsim.runs.kinds import kind_of
from jaxsim.runs.run import Checkpoints, load_run
from jaxsim.simulate.embedded import FILES, FOLDER, SUMS_FILE, name_of, shapes_of


def pack(source: Path, folder: Path = FOLDER) -> None:
    """Writes the settings, the averaged generator and the grain of a trained run, and their SHA-256. Where the run lay
    is left out: that is of the machine that trained it."""
    run = load_run(source)
    parameters = Checkpoints(source).restore("generator", shapes_of(run))
    leaves = jax.tree.leaves_with_path(parameters)
    stored: dict[str, Any] = {name_of(path): np.asarray(leaf) for path, leaf in leaves}
    np.savez_compressed(folder / "generator.npz", **stored)
    kept = replace(run.experiment.run, out=RunConfig().out)
    settings = replace(run, experiment=replace(run.experiment, run=kept))
    (folder / "config.json").write_bytes(kind_of(settings).dump(settings))
    (folder / "grain.json").write_bytes((source / "grain.json").read_bytes())
    (folder / SUMS_FILE).write_text("".join(f"{sha256_of(folder / name)}  {name}\n" for name in FILES))


if __name__ == "__main__":
    pack(Path(sys.argv[1]))
