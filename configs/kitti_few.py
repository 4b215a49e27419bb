"""Few real frames, of one drive: what each laser line answers to range and angle, and nothing of the image.

jaxsim train kitti_few --data.root KITTI_RAW
jaxsim eval runs/kitti_few

What needs no image need not look where the camera does: it learns from all sides of the scans (`--optim.sides`). Scans
that are cropped to the image have no other sides: `--optim.sides 0`. See docs/scores.md, few real frames.
"""

from jaxsim.config import DataConfig, Experiment, GeneratorConfig, LossConfig, OptimConfig, PrepareConfig, RunConfig

experiment = Experiment(
    data=DataConfig(kind="kitti_raw", train="0-3", validation="4-5"),
    prepare=PrepareConfig(
        inputs=("log_range", "incidence", "beam"),
        depth="ip_basic",
        network_size=(44, 372),  # the window itself
    ),
    # Each cell for itself: it gives the same answer however it is looked at.
    generator=GeneratorConfig(form="unet", filters=16, downsamples=0, enhancers=0, looks=1),
    loss=LossConfig(gan=0.0, feature_matching=0.0, reconstruction=1.0, drops=0.05, occluded_weight=1.0),
    optim=OptimConfig(
        lr=5e-3,
        betas=(0.9, 0.99),
        batch=4,
        columns=64,
        steps=600,
        warm_up=20,
        decay_from=0.0,
        clip=1.0,
        flip=True,
        sides=1.0,
        ema_start=50,
        ema_decay=0.98,
    ),
    run=RunConfig(name="kitti_few", save_every=600, picture_every=600),
)
