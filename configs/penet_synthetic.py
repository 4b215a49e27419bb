"""PENet, a small one, on the embedded world: dense depth where the truth is known.

    python train.py penet_synthetic

40 frames of as many streets, 8.4 million parameters, 360 updates. Not run to its end yet: no score to promise.
"""

from jaxsim.config import DataConfig, RunConfig
from jaxsim.prepare.depth.penet.training import DepthExperiment, PenetConfig, Stage

CROP = (160, 512)

experiment = DepthExperiment(
    data=DataConfig(kind="synthetic", train="0-159:4", validation="1920-1959:4"),
    image_crop=(352, 1216),
    penet=PenetConfig(
        width=8,
        start_m=15.0,
        stages=(
            Stage("branches", 12, 2, CROP, ((8, 0.5), (11, 0.1))),
            Stage("refinement", 3, 2, CROP, ((2, 0.1),)),
            Stage("joint", 3, 2, CROP, ((2, 0.1),)),
        ),
    ),
    run=RunConfig(name="penet_synthetic", log_every=10, save_every=100, picture_every=120),
)
