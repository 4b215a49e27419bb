"""How far a simulated frame is from the measured one, and one set of frames from another.

paired.py intervals.py      frame by frame, and intervals over scenes
cloud_checks.py             clouds of other streets
depth.py detection/         depth completion and detectors, by KITTI's rules
frechet.py inception/       Fréchet distance, and the features of images that it is taken of
bev.py chamfer.py conditional.py rangenet.py sliced_wasserstein.py   as the field of LiDAR generation measures clouds
"""

from jaxsim.metrics.paired import Score, paired_scores, paired_sums

__all__ = ["Score", "paired_scores", "paired_sums"]
