"""nuScenes' sensor, an HDL-32E: what each of its lines answers to range and angle, learned from polar frames alone.

jaxsim frames samples/LIDAR_TOP --out POLAR         # of nuScenes v1.0
jaxsim train nuscenes --data.root POLAR
jaxsim eval runs/nuscenes

2000 steps: a minute of one core. Learned from 24 range images of as many streets and judged on eight others (90 %
intervals over these), without classes: intensity MAE 0.0459 (0.0454..0.0465), as near as the table of range, incidence
and line (0.0458); with the classes of the points as a further input 0.0387 (0.0379..0.0395). See docs/data-sets.md.
"""

from jaxsim.config import DataConfig, Experiment, GeneratorConfig, LossConfig, OptimConfig, PrepareConfig, RunConfig

experiment = Experiment(
    data=DataConfig(kind="polar", train="0-95", validation="96-127"),  # four views a frame: of 32 frames the first 24
    prepare=PrepareConfig(
        inputs=("log_range", "incidence", "beam"),
        depth="ip_basic",
        image_crop=(240, 416),
        columns=160,  # of a quarter turn: fewer than firings, which the car's motion spreads unevenly
        network_size=(32, 160),
    ),
    generator=GeneratorConfig(
        form="unet", filters=16, max_filters=64, downsamples=0, enhancers=0
    ),  # each cell for itself
    loss=LossConfig(gan=0.0, feature_matching=0.0, reconstruction=1.0, drops=0.05, occluded_weight=1.0),
    optim=OptimConfig(
        lr=5e-3,
        betas=(0.9, 0.99),
        batch=4,
        columns=64,
        steps=2000,
        warm_up=20,
        decay_from=0.0,
        clip=1.0,
        flip=True,
        ema_start=50,
        ema_decay=0.98,
    ),
    run=RunConfig(name="nuscenes", save_every=1000, picture_every=1000),
)
