"""KITTI's object evaluation: average precision of boxes in the image, from above and in space, and of orientation.

The official tool's rules (devkit_object, evaluate_object_3d_offline) by default, OpenPCDet's by option.
"""

from jaxsim.metrics.detection.evaluate import Curve, evaluate
from jaxsim.metrics.detection.files import Objects, read_detections, read_truth
from jaxsim.metrics.detection.rules import CLASSES, COLUMNS, DIFFICULTIES, METRICS, OVERLAP_SETS, Rules

__all__ = [
    "CLASSES",
    "COLUMNS",
    "DIFFICULTIES",
    "METRICS",
    "OVERLAP_SETS",
    "Curve",
    "Objects",
    "Rules",
    "evaluate",
    "read_detections",
    "read_truth",
]
