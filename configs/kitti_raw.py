"""Real frames: a KITTI raw drive, on a laptop CPU."""

from jaxsim.config import (
    DataConfig,
    DiscriminatorConfig,
    Experiment,
    GeneratorConfig,
    LossConfig,
    OptimConfig,
    PrepareConfig,
    RunConfig,
)

experiment = Experiment(
    data=DataConfig(kind="kitti_raw", train="0-3", validation="4-5"),
    prepare=PrepareConfig(inputs=("rgb", "depth", "row"), depth="ip_basic"),
    generator=GeneratorConfig(filters=16, blocks=3, downsamples=3, enhancer_blocks=2),
    discriminator=DiscriminatorConfig(filters=16, max_filters=128),
    loss=LossConfig(gan=1.0, feature_matching=10.0, perceptual=0.0, reconstruction=100.0),
    optim=OptimConfig(lr=1e-3, batch=4, steps=400, decay_from=0.5, flip=False, ema_start=100, ema_decay=0.99),
    run=RunConfig(name="kitti_raw", save_every=100, picture_every=100),
)
