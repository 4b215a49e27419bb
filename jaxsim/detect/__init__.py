"""Voxel R-CNN (Deng et al., AAAI 2021), in OpenPCDet's form: boxes from a point cloud. Knows nothing of who made it."""
