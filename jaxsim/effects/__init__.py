"""What an ideal ray model leaves out: laws that light, optics, electronics and mounting follow, and their catalogue.

In the order of reading:

    rays.py         `Scan`, simulated frames; `Rays`, what each ray meets and what becomes of it;
                    `covariates`, what a reading may depend on: range, row, class, colour ...
    places.py       rays of a scan by their places, and the places beside them
    effect.py       `Law`, a pure function on rays with its parameters; `Effect`, a law with its row of the catalogue
    catalogue/      the 42 effects, a file each; `EFFECTS` lists them in physical order
    edits.py        the few ways in which laws change rays, early false returns among them
    recast.py       what rays meet that a law turned or moved
    region.py       where an effect acts, if not everywhere
    learned.py      what no effect describes, as numbers along covariates
    chain.py        `SensorModel`, effects applied in order: the content of sensor.json; one draw of what it reports
    origin.py       effects of one's own, and where they come from
    own.py          `known_effects`: the catalogue with those of packages and files; check.py has what they must keep
                    to, street.py the street on which they are tried
    scan.py         a `Scan` of frames as they are read from files, with the surfaces of their range images
    page.py         the catalogue in words, docs/effects.md

    model = SensorModel((("beam_gain", {"gain": 0.1}), ("random_dropout", {"probability": 0.05})))
    reported = model.simulate(scan_of(grid, images), jax.random.key(0))
"""

from jaxsim.effects.catalogue import EFFECTS, get_effect
from jaxsim.effects.effect import CHANNELS, COVARIATE_NAMES, STAGES, Effect, Law, Parameter
from jaxsim.effects.places import all_rays
from jaxsim.effects.rays import Scan
from jaxsim.effects.scan import scan_of

__all__ = [
    "CHANNELS",
    "COVARIATE_NAMES",
    "EFFECTS",
    "STAGES",
    "Effect",
    "Law",
    "Parameter",
    "Scan",
    "all_rays",
    "get_effect",
    "scan_of",
]
