"""The answer of `jaxsim discover` in the parameters of other simulators: `jaxsim engines sensor.json --for carla`.

engine      the answer with its intervals; what an engine is; `translate`
carla, isaac, rgl, gazebo, helios    an engine each: what it can express, in its own format, and what it cannot
"""

from pathlib import Path

from jaxsim.engines import carla, gazebo, helios, isaac, rgl
from jaxsim.engines.engine import Engine, Estimate, Estimates, Setting, Translation, read_answer, translate

__all__ = [
    "ENGINES",
    "Engine",
    "Estimate",
    "Estimates",
    "Setting",
    "Translation",
    "check_page",
    "read_answer",
    "translate",
]

ENGINES: dict[str, Engine] = {
    "carla": carla.ENGINE,
    "isaac": isaac.ENGINE,
    "rgl": rgl.ENGINE,
    "gazebo": gazebo.ENGINE,
    "helios": helios.ENGINE,
}
"""Every engine by its name."""


def check_page(path: Path) -> None:
    """Raises ValueError where a file is there that is no page of `jaxsim engines`, which begins with an engine's name:
    it would be lost."""
    if not path.is_file():
        return
    first = path.read_text(encoding="utf-8", errors="replace").split("\n", 1)[0]
    if first not in {f"# {engine.title}" for engine in ENGINES.values()}:
        raise ValueError(f"engines: {path}, where the words would go, is no page of this command; give another --out")
