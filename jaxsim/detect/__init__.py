"""Voxel R-CNN (Deng et al., AAAI 2021), in OpenPCDet's form: boxes from a point cloud. Knows nothing of who made it."""

from jaxsim.detect.batches import SceneBatches
from jaxsim.detect.steps import LeftOut, create_state, make_train_step, network_shapes

__all__ = ["LeftOut", "SceneBatches", "create_state", "make_train_step", "network_shapes"]
