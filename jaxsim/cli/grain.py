"""`jaxsim grain`: how the cells of a learned sensor's draws scatter together."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from jaxsim.cli.flags import SAME, DataSource
from jaxsim.config.ranges import Checked
from jaxsim.files import as_argument
from jaxsim.pairs.prepared import prepared
from jaxsim.report.results import markdown_table
from jaxsim.simulate.embedded import is_embedded
from jaxsim.simulate.grain import Field, save_grain
from jaxsim.simulate.grain_fit import NO_DISTRIBUTION, learn_grain
from jaxsim.simulate.learned_sensor import load
from jaxsim.simulate.predict import make_predict


@dataclass(frozen=True)
class LearnGrain(Checked):
    """Learns from measured frames how intensities and lost rays of cells beside each other scatter together about what
    the network says, and writes it to RUN/grain.json, which `jaxsim simulate --draws` reads.

    `jaxsim train` does so at its end, on the validation frames; this is for runs of before, for joined ones, and for
    other frames. Take frames that the network has not learned from, of several drives.
    """

    run: Annotated[Path, tyro.conf.Positional]
    """Folder of the run, whose network gives a distribution (--generator.form unet)."""
    data: DataSource = SAME
    """Data set to learn from."""
    frames: str = ""
    """Frames to learn from: `0-99`. Empty: the run's validation frames, or all of another data set."""

    def __call__(self) -> None:
        if is_embedded(self.run):
            raise ValueError("grain: the packaged sensor has its grain with it; give the folder of a run of yours")
        learned = load(self.run)
        if learned.run.experiment.generator.form != "unet":  # before frames are prepared for it
            raise ValueError(NO_DISTRIBUTION)
        of_run, prepare = learned.run.experiment.data, learned.run.experiment.prepare
        data = self.data.config(of_run)
        dataset, positions = self.data.open(of_run, frames=self.frames, run=self.run)
        pairs = prepared(dataset, positions, data, prepare=prepare)
        grain = learn_grain(make_predict(learned.generate, prepare), learned.params, pairs, scenes=pairs.scenes)
        for what, fields in (("intensity", grain.intensity), ("lost rays", grain.drop)):
            print(f"{what}\n\n{markdown_table(['share', 'columns', 'rows', 'edge, m'], [*map(_row, fields)])}\n")
        print(f"{save_grain(self.run, grain)}: jaxsim simulate {as_argument(self.run)} --draws")


def _row(field: Field) -> list[str]:
    if field.single:
        return [f"{field.share:.3f}", "each cell", "", ""]
    if field.columns is None:
        return [f"{field.share:.3f}", "all of a class", "", ""]
    edge = "-" if field.edge_m is None else f"{field.edge_m:g}"
    return [f"{field.share:.3f}", f"{field.columns:g}", f"{field.rows:g}", edge]
