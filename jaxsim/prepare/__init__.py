"""From a frame's camera and LiDAR to an aligned training pair on the sensor's own polar grid.

pairs              the whole way, a frame to a pair
depth, denoise     dense depth of the camera's pixels; intensities without noise
paint, channels    camera rasters on the polar grid; what the network sees of them
"""

from __future__ import annotations

from jaxsim.prepare.channels import INPUT_CHANNELS, edge_map, input_channels, network_inputs
from jaxsim.prepare.denoise import denoise
from jaxsim.prepare.depth import sparse_depth
from jaxsim.prepare.paint import paint, paint_raster, shrink
from jaxsim.prepare.pairs import (
    check_frame,
    check_networks,
    check_view,
    crop_image,
    dense_view,
    polar_window,
    prepare_frame,
    prepare_view,
)

__all__ = [
    "INPUT_CHANNELS",
    "check_frame",
    "check_networks",
    "check_view",
    "crop_image",
    "denoise",
    "dense_view",
    "edge_map",
    "input_channels",
    "network_inputs",
    "paint",
    "paint_raster",
    "polar_window",
    "prepare_frame",
    "prepare_view",
    "shrink",
    "sparse_depth",
]
