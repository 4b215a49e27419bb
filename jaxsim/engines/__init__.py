"""The answer of `jaxsim discover` in the parameters of other simulators: `jaxsim engines sensor.json --for carla`.

engine      the answer with its intervals; what an engine is; `translate`
carla, isaac, rgl, gazebo, helios    an engine each: what it can express, in its own format, and what it cannot
"""

from jaxsim.engines import carla, gazebo, helios, isaac, rgl
from jaxsim.engines.engine import Engine, Estimate, Estimates, Setting, Translation, read_answer, translate

__all__ = ["ENGINES", "Engine", "Estimate", "Estimates", "Setting", "Translation", "read_answer", "translate"]

ENGINES: dict[str, Engine] = {
    "carla": carla.ENGINE,
    "isaac": isaac.ENGINE,
    "rgl": rgl.ENGINE,
    "gazebo": gazebo.ENGINE,
    "helios": helios.ENGINE,
}
"""Every engine by its name."""
