"""nuScenes' sensor, an HDL-32E: what each of its lines answers to range and angle, learned from polar frames alone.

jaxsim frames samples/LIDAR_TOP --out POLAR         # of nuScenes v1.0
jaxsim train nuscenes --data.root POLAR
jaxsim eval runs/nuscenes

2000 steps: a minute of one core. Learned from 24 range images of as many streets and judged on eight others (90 %
intervals over these), without classes: intensity MAE 0.0459 (0.0454..0.0465), as near as the table of range, incidence
and line (0.0458); with the classes of the points as a further input 0.0387 (0.0379..0.0395). See docs/data-sets.md.
"""

from dataclasses import replace

from configs.kitti_few import experiment as few

experiment = replace(
    few,
    data=replace(few.data, kind="polar", train="0-95", validation="96-127"),  # four views a frame: of 32 the first 24
    prepare=replace(
        few.prepare,
        image_crop=(240, 416),
        columns=160,  # of a quarter turn: fewer than firings, which the car's motion spreads unevenly
        network_size=(32, 160),
    ),
    generator=replace(few.generator, filters=16, max_filters=64),
    optim=replace(few.optim, steps=2000, sides=0.0),  # its frames are views all round
    run=replace(few.run, name="nuscenes", save_every=1000, picture_every=1000),
)
