"""Point clouds: from depth maps, thinned to laser lines, and out to files that other tools open.

pseudo_lidar, sparsify         depth maps to points; dense clouds to laser lines
formats, kitti_tree            files of clouds, trees of the KITTI benchmark
"""

from jaxsim.cloud.formats import FORMATS, points_of, save_cloud
from jaxsim.cloud.pseudo_lidar import depth_to_cloud, place_intensity
from jaxsim.cloud.sparsify import PATTERNS, EvenLines, crop_cloud, sparsify

__all__ = [
    "FORMATS",
    "PATTERNS",
    "EvenLines",
    "crop_cloud",
    "depth_to_cloud",
    "place_intensity",
    "points_of",
    "save_cloud",
    "sparsify",
]
