"""Voxel R-CNN for cars on KITTI: OpenPCDet's `voxel_rcnn_car.yaml`, number for number.

    jaxsim train voxel_rcnn_car --data.root KITTI_OBJECT

7,586,620 parameters, 80 epochs. Batch 2 a GPU is published; `--optim.batch` is over all devices. OpenPCDet reports
84.54 3D AP (R11) of moderate cars on the 3769 frames of val. KITTI's download has neither the split,
ImageSets/train.txt and ImageSets/val.txt, nor the road planes on which OpenPCDet sets pasted cars: with
training/planes/ pass `--augment.on-ground`. The last five epochs are kept, and `jaxsim eval
runs/voxel_rcnn_car` averages their scores, as the paper does.
Not run here: no KITTI object set and no GPU were at hand.
"""

from jaxsim.config import DataConfig, DetectorExperiment, RunConfig

experiment = DetectorExperiment(
    data=DataConfig(kind="kitti_object", train="train", validation="val"),
    run=RunConfig(name="voxel_rcnn_car", save_every=0, picture_every=0, keep=5, log_every=50),
)
