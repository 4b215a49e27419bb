"""Point clouds out: files that other tools open."""

from jaxsim.cloud.export import FORMATS, points_of, save_cloud

__all__ = ["FORMATS", "points_of", "save_cloud"]
