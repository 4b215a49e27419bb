"""What simulated intensity is worth to who tells classes apart: segmentation of range images.

The loop of SqueezeSegV2 (Wu et al. 2019), whose intensities are rendered by a network that learned them from real
scans, with three kinds of training images of the same geometry and labels:

none        no intensity
simulated   that of a sensor which learned it from other parts, from range, place, line and class, and never saw these
measured    the sensor's own

All are judged on measured intensities of parts that neither network saw. OUT/settings.json, OUT/intensity/PART.npz,
OUT/scores/KIND_part0_seed0.json, OUT/segmentation.{md,json}.
"""

KINDS = ("none", "simulated", "measured")
"""Intensities that networks learn from, in the order of the table."""
