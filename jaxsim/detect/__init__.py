"""Voxel R-CNN (Deng et al., AAAI 2021), in OpenPCDet's form: boxes from a point cloud. Knows nothing of who made it.

scenes, batches        a frame as the detector sees it; training batches with pasted objects
voxelize, sparse       points to voxels; sparse convolution with static shapes
layers, backbones      layers with PyTorch's arithmetic; voxels to a map from above to anchors' outputs
anchors, roi_head      the first stage's boxes; the second stage, and what it learns from
losses, network, steps losses of both stages, the network whole, its training step
published, results     OpenPCDet's checkpoints; detections as KITTI writes them
"""

from jaxsim.detect.batches import SceneBatches
from jaxsim.detect.steps import LeftOut, create_state, make_train_step, network_shapes

__all__ = ["LeftOut", "SceneBatches", "create_state", "make_train_step", "network_shapes"]
