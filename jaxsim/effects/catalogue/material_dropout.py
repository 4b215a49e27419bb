"""Some materials return nothing, however much light falls on them: glass, black paint, wet road."""

from __future__ import annotations

from jaxsim.effects.edits import lose, of_class
from jaxsim.effects.effect import Effect, Parameter
from jaxsim.effects.rays import Array, Rays, Scan


def apply(p: dict[str, Array], rays: Rays, scan: Scan) -> Rays:
    """Loses echoes with the probability of the class."""
    return lose(rays, of_class(p["probability"], rays))


EFFECT = Effect(
    name="material_dropout",
    stage="detection",
    title="some classes lose returns",
    formula="keep *= 1 − probability[class]",
    parameters={
        "probability": Parameter(0.0, 0.0, 0.95, "", "share of echoes lost, a class", scale=0.2, shape="class"),
    },
    channels=("drop",),
    betrays="Returns are missing by class, at equal predicted power and angle.",
    covariates=("class",),
    look_alikes={
        "snr_dropout": "at equal power a threshold loses all classes alike",
        "specular_lobe": "mirror loss grows with the incidence angle",
        "random_dropout": "compare classes",
    },
    source="glass and black paint: general; wet road: SysCV/LiDAR_snow_sim (phy_equations.py)",
    apply=apply,
    starts=({"probability": 0.02},),
)
