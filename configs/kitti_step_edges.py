"""Edges of classes and objects alone: *edges* of the paper's first table (FID 102.61).

    jaxsim train kitti_step_edges --data.root KITTI_TRACKING --loss.vgg-weights vgg19.npz \\
        --prepare.denoise-weights lidia.npz

All else is as in kitti_step_combined. Not run here.
"""

from dataclasses import replace

from configs.kitti_step_combined import experiment as combined

experiment = replace(combined, prepare=replace(combined.prepare, inputs=("edges",)))
