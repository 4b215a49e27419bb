"""Single beams lose returns."""

from __future__ import annotations

from jaxsim.effects.edits import lose
from jaxsim.effects.effect import Effect, Parameter
from jaxsim.effects.rays import Array, Rays


def apply(p: dict[str, Array], rays: Rays) -> Rays:
    """Loses each echo with the probability of its beam."""
    return lose(rays, p["probability"][rays.row])


EFFECT = Effect(
    name="beam_dropout",
    stage="detection",
    title="single beams are dead, or lose returns",
    formula="keep *= 1 − probability[row]",
    parameters={
        "probability": Parameter(
            0.0, 0.0, 0.999, "", "share of each beam's echoes lost", scale=0.1, shape="row", sparse=True
        ),
    },
    channels=("drop",),
    signature="Rows without returns, or with fewer than their neighbours, at all ranges, angles and classes.",
    covariates=("row",),
    look_alikes={
        "snr_dropout": "a weak beam loses far and dark surfaces, and its intensities are low; a dead one loses all",
        "random_dropout": "compare beams",
        "sector_occlusion": "a dead beam is dead at all azimuths",
        "packet_loss": "lost packets take columns",
    },
    source="Goelles, Schlager and Muckenhuber, Fault Detection, Isolation, Identification and Recovery (FDIIR) Methods "
    "for Automotive Perception Sensors Including a Detailed Literature Survey for Lidar, Sensors 2020",
    apply=apply,
    starts=({"probability": 0.05}, {"probability": 0.5}),
)
