"""Voxel R-CNN (Deng et al., AAAI 2021), in OpenPCDet's form: boxes from a point cloud. Knows nothing of who made it."""

from jaxsim.detect.batches import SceneBatches
from jaxsim.detect.network import Detections, VoxelRcnn
from jaxsim.detect.results import Found, result_lines, write_lines
from jaxsim.detect.scenes import Scene, View, scene_of
from jaxsim.detect.state import Network, TrainState, create_state, network_shapes
from jaxsim.detect.steps import LeftOut, make_detect, make_train_step

__all__ = [
    "Detections",
    "Found",
    "LeftOut",
    "Network",
    "Scene",
    "SceneBatches",
    "TrainState",
    "View",
    "VoxelRcnn",
    "create_state",
    "make_detect",
    "make_train_step",
    "network_shapes",
    "result_lines",
    "scene_of",
    "write_lines",
]
