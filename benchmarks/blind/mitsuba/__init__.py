"""A second world for blind tests of discovery: streets whose light is computed by Mitsuba 3, a renderer by others.

make_case(seed, effect=, severity=, simulator=, sensor=, given=, out=) -> Truth writes OUT/measured, OUT/simulated and
OUT.key.json. Nothing of the package under test is imported, nor of the generator of benchmarks/blind/hidden.

Read in this order: materials (what surfaces do with light), shapes, street, things, streets (where they stand), render
(rays to surfaces), roughness (the law of a rough surface, rendered), sensors, effects (what may be hidden), measure and
case.

A sensor whose emitter and eye are in one place sees of a surface f(θ, θ) cos θ, f being its BRDF: Mitsuba's
`BSDF.eval` at the hit, with both directions along the ray. Units: m, rad; intensity 1 is white Lambert, head on, over
`sensors.WHITE`.
"""

from importlib.util import find_spec

if find_spec("mitsuba") is None:
    raise ModuleNotFoundError("mitsuba is not installed; pip install -e '.[worlds]' brings it", name="mitsuba")

from benchmarks.blind.mitsuba.case import Truth, key_path, make_case
from benchmarks.blind.mitsuba.effects import EFFECTS
from benchmarks.blind.mitsuba.sensors import SENSORS, SIMULATORS

__all__ = ["EFFECTS", "SENSORS", "SIMULATORS", "Truth", "key_path", "make_case"]
