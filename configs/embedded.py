"""The sensor that travels with the package: `jaxsim.load("embedded")`.

    jaxsim train embedded
    jaxsim eval runs/embedded
    python -m jaxsim.simulate.embedded.pack runs/embedded

240 frames, one of each street; the U-Net and the losses of `kitti_drives`, which also say how far each cell is known.
It looks once: four looks are no nearer here, and take three times as long.
5000 steps: a minute for the frames and 12 for the steps, on one core beside other work. Intensity MAE 0.0464 on 40
frames of unseen streets; table of range, incidence and row 0.0828, previous frame 0.0807.
What the packaged weights scored stands beside them, in jaxsim/simulate/embedded/card.md.
"""

from dataclasses import replace

from configs.kitti_drives import experiment as kitti_drives
from configs.synthetic import experiment as synthetic

experiment = replace(
    kitti_drives,
    data=replace(synthetic.data, train="0-959:4"),
    prepare=replace(
        synthetic.prepare,
        inputs=("rgb", "log_range", "semantic", "incidence", "beam", "surroundings"),
        network_size=(44, 372),  # the window itself
    ),
    generator=replace(kitti_drives.generator, widen=1.0, looks=1),
    run=replace(kitti_drives.run, name="embedded", save_every=500, picture_every=1000),
)
