"""How far one set of clouds is from another, as the field of LiDAR generation measures it."""

from jaxsim.metrics.generation.bev import COUNTS, jensen_shannon, lidm_occupancy, mmd
from jaxsim.metrics.generation.chamfer import Chamfer, chamfer, minimum_matching_distance
from jaxsim.metrics.generation.conditional import Conditional, conditional_intensity, intensity_table
from jaxsim.metrics.generation.sliced_wasserstein import sliced_wasserstein

__all__ = [
    "COUNTS",
    "Chamfer",
    "Conditional",
    "chamfer",
    "conditional_intensity",
    "intensity_table",
    "jensen_shannon",
    "lidm_occupancy",
    "minimum_matching_distance",
    "mmd",
    "sliced_wasserstein",
]
