"""PENet, a small one, on the embedded world: dense depth where the truth is known.

    python train.py penet_synthetic

80 frames of as many streets, 8.4 million parameters, 1600 updates in three stages.
"""

from jaxsim.config import DataConfig, RunConfig
from jaxsim.prepare.depth.penet.training import DepthExperiment, PenetConfig, Stage

CROP = (96, 320)

experiment = DepthExperiment(
    data=DataConfig(kind="synthetic", train="0-319:4", validation="1920-1959:4"),
    image_crop=(256, 1216),  # above it hardly a pixel is backed by the sweep's points
    penet=PenetConfig(
        width=8,
        lr=5e-3,
        loss="huber",
        start_m=10.0,
        stages=(
            Stage("branches", 30, 2, CROP, ((18, 0.4), (25, 0.1))),
            Stage("refinement", 4, 2, CROP, ((3, 0.2),)),
            Stage("joint", 6, 2, CROP, ((4, 0.2),)),
        ),
    ),
    run=RunConfig(name="penet_synthetic", log_every=10, save_every=100, picture_every=200),
)
