"""From a frame's camera and LiDAR to an aligned training pair on the sensor's own polar grid."""

from __future__ import annotations

from jaxsim.prepare.channels import CHANNELS, CLASSES, input_channels, network_inputs
from jaxsim.prepare.denoise import denoise
from jaxsim.prepare.depth import complete_depth
from jaxsim.prepare.depth.sparse import sparse_depth
from jaxsim.prepare.edges import edge_map
from jaxsim.prepare.occlusion import occluded
from jaxsim.prepare.paint import paint
from jaxsim.prepare.pairs import crop_image, prepare_frame, view_on_window

__all__ = [
    "CHANNELS",
    "CLASSES",
    "complete_depth",
    "crop_image",
    "denoise",
    "edge_map",
    "input_channels",
    "network_inputs",
    "occluded",
    "paint",
    "prepare_frame",
    "sparse_depth",
    "view_on_window",
]
