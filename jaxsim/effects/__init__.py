"""What light, optics and electronics do: laws on rays (`effect.py`), the 38 of them (`catalogue/`), chains of them."""

from jaxsim.effects.catalogue import EFFECTS, get_effect
from jaxsim.effects.effect import CHANNELS, COVARIATES, STAGES, Effect, Law, Parameter
from jaxsim.effects.rays import Rays, Scan, all_rays, rays_at
from jaxsim.effects.scan import scan_of

__all__ = [
    "CHANNELS",
    "COVARIATES",
    "EFFECTS",
    "STAGES",
    "Effect",
    "Law",
    "Parameter",
    "Rays",
    "Scan",
    "all_rays",
    "get_effect",
    "rays_at",
    "scan_of",
]
