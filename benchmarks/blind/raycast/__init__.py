"""A second hidden world with its own code: rays cast by Embree into an indoor hall or onto a motorway.

    python -m benchmarks.blind.raycast make DIR --seed 7 --sensor spin64 --simulator noisy --given bare

writes DIR/measured and DIR/simulated (polar frames) and, beside the folder, DIR.key.json: what is hidden, in the form
that `benchmarks.blind.hidden.score` reads. It shares no code with the package under test nor with
benchmarks/blind/hidden (import-linter holds it to that), only the sizes of severity 1 in hidden/units.json. Read:

    scenes (hall.py, motorway.py)  meshes made of a seed      materials   albedo tables and textures in space
    sensors                        rasters of four sensors    optics      echoes of a beam, and what a simulator sees
    effects                        what can be hidden         simulators  errors that the simulated side has of its own
    case                           two folders and the key

Unlike in the first world, the ideal simulator renders the textures of its materials, an echo at an edge has the albedo
of the surface that it comes from, and beside Lambert's law stands Oren and Nayar's with its interreflections. Needs
trimesh and embreex: pip install -e '.[worlds]'.
"""

from benchmarks.blind.raycast.case import make_case
from benchmarks.blind.raycast.effects import EFFECTS
from benchmarks.blind.raycast.sensors import SENSORS
from benchmarks.blind.raycast.simulators import SIMULATORS

__all__ = ["EFFECTS", "SENSORS", "SIMULATORS", "make_case"]
