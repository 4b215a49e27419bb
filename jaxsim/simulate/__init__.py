"""The learned sensor: from what a renderer knows to what the LiDAR reports."""

from jaxsim.simulate.predict import make_batch, make_predict, predict_intensity
from jaxsim.simulate.sensor import LearnedSensor, load, simulate_frame

__all__ = ["LearnedSensor", "load", "make_batch", "make_predict", "predict_intensity", "simulate_frame"]
