"""PENet, a small one, on the embedded world: dense depth where the truth is known.

    jaxsim train penet_synthetic

80 frames of as many streets, 8.4 million parameters, 1200 updates of the branches, 160 of the refinement, 160 of all:
24 to 44 minutes of processor time. On ten frames of other streets: RMSE 2881 mm, MAE 852 mm, iRMSE 22.2 /km, iMAE
9.41 /km; beside IP-Basic in docs/depth-completion.md.
"""

from jaxsim.config import DataConfig, DepthExperiment, PenetConfig, RunConfig, Stage

CROP = (128, 256)

experiment = DepthExperiment(
    data=DataConfig(kind="synthetic", train="0-319:4", validation="1920-1959:4"),
    image_crop=(256, 1216),  # above it hardly a pixel is backed by the sweep's points
    penet=PenetConfig(
        width=8,
        lr=5e-3,
        loss="huber",
        start_m=15.0,
        stages=(
            Stage("branches", 30, 2, CROP, ((16, 0.4), (23, 0.12), (28, 0.04)), "renorm"),
            Stage("refinement", 4, 2, CROP, ((3, 0.2),), "renorm"),
            Stage("joint", 4, 2, CROP, ((0, 0.4), (2, 0.1)), "stored"),
        ),
    ),
    run=RunConfig(name="penet_synthetic", log_every=10, save_every=100, picture_every=100),
)
