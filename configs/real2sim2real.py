"""Real2Sim2Real on the embedded world, on a laptop CPU: no files, no GPU.

    jaxsim real2sim2real --config real2sim2real

*Real* is the true sensor in a town; *synthetic* is an ideal renderer in a suburb, where less parks and more drives. The
sensor learns from 240 streets, a detector of each kind of cloud from 160 frames, and all are scored on 80 frames of
other streets. The first seed took 86 minutes on two cores that other work shared, a further one 69. Moderate 3D AP of
cars on real clouds after the last epoch (`--seeds 0 1 2`): 54.3 after simulated intensity, 60.7 without intensity, 58.0
after real clouds. These detectors make nothing of intensity (docs/real2sim2real.md says why).
"""

from dataclasses import replace

from configs.ablation import experiment as intensity
from configs.voxel_rcnn_small import experiment as detector
from jaxsim.config import LoopConfig

real = replace(intensity.data, train="0-1919:12", validation="1920-2079:2")
loop = LoopConfig(
    intensity=intensity,
    detector=replace(
        detector,
        data=real,
        voxels=replace(detector.voxels, max_voxels_train=10000),
        optim=replace(detector.optim, epochs=10),
        run=replace(detector.run, picture_every=1_000_000),
    ),
    synthetic=replace(real, seed=1, streets="suburb"),
)
