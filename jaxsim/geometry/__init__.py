"""Rays, cameras and rasters: where beams point, how points become a polar image and back, what a camera sees."""

from jaxsim.geometry.camera import (
    camera_at_lidar,
    camera_from_projection,
    camera_rows,
    camera_window,
    crop_camera,
    invert,
    project,
    transform,
    unproject,
)
from jaxsim.geometry.normals import incidence, normals
from jaxsim.geometry.polar import (
    azimuth_of,
    column_of,
    crop,
    directions,
    points_to_polar,
    polar_to_points,
    resample,
    resample_grid,
    rows_of,
    scatter_nearest,
)
from jaxsim.geometry.rows import UnorderedCloud, fit_beams, recover_rows, rows_by_elevation
from jaxsim.geometry.sensor import PRESETS, LidarSpec, full_grid, preset, window_grid

__all__ = [
    "PRESETS",
    "LidarSpec",
    "UnorderedCloud",
    "azimuth_of",
    "camera_at_lidar",
    "camera_from_projection",
    "camera_rows",
    "camera_window",
    "column_of",
    "crop",
    "crop_camera",
    "directions",
    "fit_beams",
    "full_grid",
    "incidence",
    "invert",
    "normals",
    "points_to_polar",
    "polar_to_points",
    "preset",
    "project",
    "recover_rows",
    "resample",
    "resample_grid",
    "rows_by_elevation",
    "rows_of",
    "scatter_nearest",
    "transform",
    "unproject",
    "window_grid",
]
