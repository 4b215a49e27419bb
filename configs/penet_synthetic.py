"""PENet, a small one, on the embedded world: dense depth where the truth is known.

    python train.py penet_synthetic

80 frames of as many streets, 8.4 million parameters, 320 updates: too few to be of use, and no more could be afforded
when this was tried. Shown up to the end of the second stage (update 240, about ten minutes of processor time of two
full cores): RMSE 5393 mm, MAE 3468 mm, iRMSE 71.6 /km, iMAE 40.3 /km on four frames of other streets, behind IP-Basic
(docs/depth-completion.md). The third stage was not run. For weights that help, give the branches many more epochs.
"""

from jaxsim.config import DataConfig, RunConfig
from jaxsim.prepare.depth.penet.training import DepthExperiment, PenetConfig, Stage

CROP = (96, 320)

experiment = DepthExperiment(
    data=DataConfig(kind="synthetic", train="0-319:4", validation="1920-1959:4"),
    image_crop=(352, 1216),
    penet=PenetConfig(
        width=8,
        start_m=15.0,
        stages=(
            Stage("branches", 5, 2, CROP, ()),
            Stage("refinement", 1, 2, CROP, ()),
            Stage("joint", 2, 2, CROP, ((1, 0.1),)),
        ),
    ),
    run=RunConfig(name="penet_synthetic", log_every=10, save_every=100, picture_every=1000),
)
