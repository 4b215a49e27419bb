"""Training: one loop, a builder for each kind of network, and the experiments that configs/ holds."""

from jaxsim.train.experiments import experiment_names, load_experiment, load_loop, read_experiment
from jaxsim.train.loop import train

__all__ = ["experiment_names", "load_experiment", "load_loop", "read_experiment", "train"]
