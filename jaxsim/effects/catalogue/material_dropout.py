"""Some materials return nothing, however much light falls on them: glass, black paint, wet road."""

from __future__ import annotations

from jaxsim.effects.edits import lose, of_class
from jaxsim.effects.effect import Effect, Parameter
from jaxsim.effects.rays import Array, Rays


def apply(p: dict[str, Array], rays: Rays) -> Rays:
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
    signature="Returns are missing by class, at equal predicted power and angle.",
    covariates=("class",),
    look_alikes={
        "snr_dropout": "at equal power a threshold loses all classes alike",
        "specular_lobe": "mirror loss grows with the incidence angle",
        "random_dropout": "compare classes",
    },
    source="Hahner et al., LiDAR Snowfall Simulation for Robust 3D Object Detection, CVPR 2022 (wet road); "
    "Manivasagam et al., LiDARsim, CVPR 2020 (returns lost by material)",
    apply=apply,
    starts=({"probability": 0.02},),
)
