"""Dense depth alone: *depth* of the paper's first table (FID 81.43).

    jaxsim train kitti_step_depth --data.root KITTI_TRACKING --loss.vgg-weights vgg19.npz \\
        --prepare.denoise-weights lidia.npz

All else is as in kitti_step_combined. Not run here.
"""

from dataclasses import replace

from configs.kitti_step_combined import experiment as combined

experiment = replace(combined, prepare=replace(combined.prepare, inputs=("depth",)))
