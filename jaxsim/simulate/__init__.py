"""The learned sensor: from what a renderer knows to what the LiDAR reports.

sensor         `LearnedSensor`, and the paper's steps in one function: `simulate_frame`
predict        the network's intensity of every ray
unprojected    the same where the network sees the camera's rasters without projection
checks         whether images are like those that the sensor learned from
effects        effects that the sensor lacks, on simulated frames
folder         a data set's frames as polar frames and clouds: `simulate_folder` (`jaxsim simulate`)
beside_drive   simulated and measured frames of one drive side by side, for `discover`
clouds, trees  the clouds that detectors learn from, and KITTI trees of them: `export_trees` (`jaxsim export`)
"""

from jaxsim.simulate.predict import make_batch, make_predict, predict_intensity
from jaxsim.simulate.sensor import LearnedSensor, load, simulate_frame

__all__ = ["LearnedSensor", "load", "make_batch", "make_predict", "predict_intensity", "simulate_frame"]
