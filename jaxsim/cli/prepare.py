"""`jaxsim prepare`: a data set's frames to training pairs on disk."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import jax
import tyro

from jaxsim.cli.flags import SAME, DataSource, IntoFolder, Scheduler
from jaxsim.config import PrepareConfig
from jaxsim.config.ranges import Count, Whole
from jaxsim.files import as_argument


@dataclass(frozen=True)
class Prepare(IntoFolder):
    """Makes the training pairs of a data set once, as a TFDS data set of ArrayRecord files.

    Each pair is a frame's camera and LiDAR on one polar grid: laser lines told apart, depth completed, images and
    labels painted, occluded cells marked, edges found, the target denoised. Training reads them:

        jaxsim prepare kitti_step --data.root KITTI_TRACKING --out PAIRS \\
            --prepare.depth ip_basic --prepare.denoise lidia --prepare.denoise-weights lidia.npz
        jaxsim train kitti_step_combined --data.kind prepared --data.root PAIRS \\
            --prepare.denoise-weights lidia.npz

    A raw drive has neither labels nor dense depth, so that the inputs leave the ones out and the other is completed:

        jaxsim prepare kitti_raw --data.root KITTI_RAW --train 0-3 --eval 4-5 --out PAIRS \\
            --prepare.depth ip_basic --prepare.inputs rgb depth incidence row
        jaxsim train kitti_raw --data.kind prepared --data.root PAIRS --data.train train --data.validation eval

    Give the --prepare flags of the experiment. What is there is not made again, so that a killed command goes on;
    the same bytes come of any number of workers. For sets that outgrow a machine, a cluster of Dask, or Apache Beam:

        jaxsim prepare ... --cluster tcp://HOST:8786
        jaxsim prepare ... --beam runner=DaskRunner dask_client_address=tcp://HOST:8786
        jaxsim prepare ... --beam runner=FlinkRunner flink_master=HOST:8081
    """

    out: Path
    """Folder to write to; the set lies in OUT/jaxsim_pairs/DATASET/1.0.0."""
    data: DataSource = SAME
    """Data set to prepare; its kind may also be the first word."""
    train: str = ""
    """Frames for training: `0-99`, `0-99:4`, or a part by name. Empty: the data set's part `training`, or all of it."""
    evaluation: Annotated[str, tyro.conf.arg(name="eval")] = ""
    """Frames to judge by. Empty: its part `evaluation`; none where --train is given."""
    pairs_a_file: Count = 64
    """A file is what a killed command makes anew, and what a worker of a cluster makes at a time."""
    workers: Whole = 0
    """Processes; 0: one a core."""
    cluster: Scheduler = None
    beam: tuple[str, ...] | None = None
    """Options of Apache Beam, as NAME=VALUE: make the files with it instead of processes of this machine."""
    prepare: PrepareConfig = field(default_factory=PrepareConfig)

    def __call__(self) -> None:
        from jaxsim.pairs.sets import make_set  # imports TFDS, which the other commands need not wait for

        source = self.data.named("prepare", "jaxsim prepare kitti_step ...")
        if source.kind == "prepared":
            raise ValueError("prepare: a prepared set is made already; name the data set of its frames")
        jax.config.update("jax_platforms", "cpu")  # before its first use: workers are processes that share no GPU
        folder = make_set(
            self.out,
            source,
            self.prepare,
            train=self.train,
            evaluation=self.evaluation,
            size=self.pairs_a_file,
            workers=self.workers,
            beam=self.beam,
            cluster=self.cluster,
        )
        root = as_argument(self.out)
        print(f"{folder}\ntrain on it: jaxsim train ... --data.kind prepared --data.root {root}")
