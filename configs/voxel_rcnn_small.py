"""A small Voxel R-CNN on the embedded world, on a laptop CPU: no files, no GPU.

    jaxsim train voxel_rcnn_small
    jaxsim eval runs/voxel_rcnn_small

Cars up to 45 m ahead of the camera, 720 steps of two scenes: 11 minutes on two cores that other work shared. On 20
frames of other streets (61 moderate cars), AP R40 of moderate ones: 3D@0.7 71.7 at the end and 57.5 in the mean of the
last five epochs, still rising; BEV@0.7 88.4 and 83.1; 3D@0.5 94.6 and 90.8. With the published first weights behind the
score (`--detector.roi.score-deviation 0.01`) it is 43.1 and 26.6 in 3D@0.7: every car ends with the same score.
"""

from jaxsim.config import (
    AnchorConfig,
    AugmentConfig,
    BackboneConfig,
    DataConfig,
    DetectorConfig,
    DetectorExperiment,
    OneCycleConfig,
    ProposalConfig,
    RoiConfig,
    RunConfig,
    VoxelConfig,
)

experiment = DetectorExperiment(
    data=DataConfig(kind="synthetic", train="0-479:4", validation="1920-1999:4"),
    scored="inside",
    voxels=VoxelConfig(
        range_m=(0.0, -22.4, -3.0, 44.8, 22.4, 1.0),
        size_m=(0.1, 0.1, 0.1),
        max_voxels_train=9000,
        max_voxels=12000,
        max_points=24576,
        growth=(1.6, 1.1, 0.6, 0.5),
    ),
    detector=DetectorConfig(
        backbone=BackboneConfig(
            widths=(8, 16, 32, 32), out=32, bev_layers=(2, 2), bev_widths=(32, 64), up_widths=(32, 32)
        ),
        anchors=AnchorConfig(),
        roi=RoiConfig(
            grid=4,
            radii_m=(0.8, 1.2, 2.4),
            width=16,
            samples=8,
            layers=(64, 64),
            score_deviation=0.1,
            dropout=0.0,
            rois=48,
        ),
        train_proposals=ProposalConfig(before=512, overlap=0.8, after=96),
        proposals=ProposalConfig(before=512, overlap=0.7, after=48),
        final=ProposalConfig(before=128, overlap=0.1, after=48),
        score=0.1,
    ),
    augment=AugmentConfig(sampled=6),
    optim=OneCycleConfig(lr=0.005, batch=2, epochs=12),
    run=RunConfig(name="voxel_rcnn_small", save_every=0, picture_every=0, keep=5),
)
