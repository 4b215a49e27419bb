"""Training: one loop, a builder for each kind of network, and the experiments that configs/ holds.

loop, training              the loop, which reads top to bottom; what it needs of a builder
intensity, detector, depth  the builders
intensity_batch             pairs as the intensity network's train step takes them
experiments                 experiments by name or by file
in_memory                   small networks that are no runs of their own
join                        one run of several that differ in their seed
"""

from jaxsim.train.experiments import experiment_names, load_experiment, load_loop, read_experiment
from jaxsim.train.loop import train

__all__ = ["experiment_names", "load_experiment", "load_loop", "read_experiment", "train"]
