"""The embedded world, on a laptop CPU: no files, no GPU.

    jaxsim train
    jaxsim eval runs/synthetic

On two cores that other work shared: 55 minutes of training. Intensity MAE 0.0524 on 40 frames of unseen streets;
per-class mean 0.1078, per-row mean 0.1183, previous frame 0.0807.
"""

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
    data=DataConfig(kind="synthetic", train="0-1919:4", validation="1920-1959"),
    prepare=PrepareConfig(
        inputs=("rgb", "depth", "semantic", "edges", "incidence", "row"),
        classes=(6, 7, 8, 11, 13, 17, 20, 21, 22, 24, 25, 26, 27, 33),
        network_size=(88, 744),  # two cells a laser line and column: the enhancer then works at the window's own size
    ),
    generator=GeneratorConfig(filters=32, blocks=3, downsamples=2, enhancer_blocks=3),
    discriminator=DiscriminatorConfig(filters=16, max_filters=128),
    loss=LossConfig(
        gan=1.0, feature_matching=2.0, perceptual=0.0, reconstruction=1000.0, drop_weight=0.5, unseen_weight=1.0
    ),
    optim=OptimConfig(flip=True, lr=1e-3, batch=2, steps=2800, decay_from=0.4, ema_start=100, ema_decay=0.99),
    run=RunConfig(name="synthetic", save_every=200, picture_every=200),
)
