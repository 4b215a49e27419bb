"""The embedded world, on a laptop CPU: no files, no GPU."""

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
    data=DataConfig(kind="synthetic", train="0-159", validation="160-199"),
    prepare=PrepareConfig(inputs=("rgb", "depth", "semantic", "edges", "incidence", "row")),
    generator=GeneratorConfig(filters=16, blocks=3, downsamples=3, enhancer_blocks=2),
    discriminator=DiscriminatorConfig(filters=16, max_filters=128),
    loss=LossConfig(gan=1.0, feature_matching=10.0, perceptual=0.0, reconstruction=100.0),
    optim=OptimConfig(lr=1e-3, batch=4, steps=1000, decay_from=0.5, ema_start=100, ema_decay=0.99),
    run=RunConfig(name="synthetic", save_every=100, picture_every=200),
)
