"""PENet on KITTI's depth completion set, at the published settings.

    jaxsim train penet_kitti --depth-root KITTI_DEPTH --data.root KITTI_RAW --depth-validation val_selection_cropped

85 898 training frames of both cameras; judged by the 1000 selected images, as the published program, or, without the
last flag, by all 6852 of val/. 131.9 million parameters, 30 + 30 + 60 epochs, on all GPUs of one machine that divide
the stages' batches of 6, 6 and 10. Not run here: the set was not at hand. Published test scores: RMSE 730 mm, MAE
211 mm.
"""

from pathlib import Path

from jaxsim.config import DataConfig, DepthExperiment, RunConfig

experiment = DepthExperiment(
    data=DataConfig(kind="kitti_raw"),
    depth_root=Path("KITTI_DEPTH"),
    run=RunConfig(name="penet_kitti", log_every=100, save_every=5000, picture_every=5000),
)
