"""The paper's studies, with their tables and pages.

ablation       which inputs count: networks that differ in their inputs alone
real2sim2real  learn the sensor, simulate with it, train detectors, score them on real clouds
segmentation   what simulated intensity is worth to who tells classes apart
"""
