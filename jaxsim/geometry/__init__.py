"""Rays, cameras and rasters: where beams point, how points become a polar image and back, what a camera sees.

sensor, beams, rows, mount  beam tables of known sensors; beams, laser lines and mounting told from points alone
polar, normals              points on the polar grid and back; angles of incidence
camera, boxes, points       pinhole cameras; boxes around objects; what points can be
"""

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
from jaxsim.geometry.normals import incidence, known_or_median, known_or_right, network_incidence, normals
from jaxsim.geometry.points import turned_points
from jaxsim.geometry.polar import (
    azimuth_of,
    cell_column,
    column_of,
    directions,
    pad_cloud,
    pad_points,
    points_to_polar,
    polar_to_points,
    resample,
    room_for,
    rows_of,
    scan_on_window,
    scatter_nearest,
    spans_turn,
    with_neighbours,
)
from jaxsim.geometry.rows import UnorderedCloud, fit_beams, recover_rows, rows_by_elevation
from jaxsim.geometry.sensor import PRESETS, LidarSpec, full_grid, grid_difference, preset, same_grid, window_grid

__all__ = [
    "PRESETS",
    "LidarSpec",
    "UnorderedCloud",
    "azimuth_of",
    "camera_at_lidar",
    "camera_from_projection",
    "camera_rows",
    "camera_window",
    "cell_column",
    "column_of",
    "crop_camera",
    "directions",
    "fit_beams",
    "full_grid",
    "grid_difference",
    "incidence",
    "invert",
    "known_or_median",
    "known_or_right",
    "network_incidence",
    "normals",
    "pad_cloud",
    "pad_points",
    "points_to_polar",
    "polar_to_points",
    "preset",
    "project",
    "recover_rows",
    "resample",
    "room_for",
    "rows_by_elevation",
    "rows_of",
    "same_grid",
    "scan_on_window",
    "scatter_nearest",
    "spans_turn",
    "transform",
    "turned_points",
    "unproject",
    "window_grid",
    "with_neighbours",
]
