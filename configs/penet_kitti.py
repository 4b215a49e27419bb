"""PENet on KITTI's depth completion set, at the published settings.

    python train.py penet_kitti --depth-root KITTI_DEPTH --data.root KITTI_RAW

85 898 training frames, 131.9 million parameters: 30 + 30 + 60 epochs on several GPUs. Not run here: the set was not at
hand. Published test scores: RMSE 730 mm, MAE 211 mm.
"""

from pathlib import Path

from jaxsim.config import DataConfig, RunConfig
from jaxsim.prepare.depth.penet.training import DepthExperiment

experiment = DepthExperiment(
    data=DataConfig(kind="kitti_raw"),
    depth_root=Path("KITTI_DEPTH"),
    run=RunConfig(name="penet_kitti", log_every=100, save_every=5000, picture_every=5000),
)
