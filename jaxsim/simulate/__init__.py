"""The learned sensor: from what a renderer knows to what the LiDAR reports.

predict        the paper's steps in one function: `simulate_frame`; the same where the network sees no projection
checks         whether images are like those that a run learned from
grain          how the cells of a draw scatter together: `Grain`, fields that go on along a surface and break at edges
grain_fit      learning it from measured frames: `learn_grain` (`jaxsim grain`)
live           in a simulator's loop: each tick's view, or what a ray caster's rays meet, to a cloud
learned_sensor `LearnedSensor`: a trained run
frames         simulated frames on the host, and effects on them
discover_sides what `discover` compares: simulated frames beside measured ones of one drive, or, until there is a
               simulator, Lambert's law beside what was measured
folder         a data set's frames as polar frames and clouds: `simulate_folder` (`jaxsim simulate`)
embedded       the sensor that travels with the package
"""

from jaxsim.simulate.learned_sensor import LearnedSensor, load
from jaxsim.simulate.predict import simulate_frame

__all__ = ["LearnedSensor", "load", "simulate_frame"]
