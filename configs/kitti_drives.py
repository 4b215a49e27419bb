"""A sensor learned from many real drives."""

from configs.kitti_raw import experiment as few
from dataclasses import replace

from jaxsim.config import DataConfig

FOLDS = (
    "drive_0009,drive_0036,drive_0070",
    "drive_0011,drive_0015,drive_0046",
    "drive_0013,drive_0028,drive_0029",
    "drive_0005,drive_0019,drive_0059",
    "drive_0022,drive_0056,drive_0096",
)
experiment = replace(few, data=DataConfig(kind="kitti_raw", train=f"all but {FOLDS[1]}", validation=FOLDS[1]))
