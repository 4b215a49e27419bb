"""Paint, glass and chrome of vehicles mirror: bright head on, lost at an angle."""

from __future__ import annotations

import jax.numpy as jnp

from jaxsim.effects.edits import brighten, cosine, is_one_of, lose
from jaxsim.effects.effect import Effect, Parameter
from jaxsim.effects.rays import Array, Rays

# Cityscapes ids, car to motorcycle.
VEHICLES = (26, 27, 28, 29, 30, 31, 32)


def apply(p: dict[str, Array], rays: Rays) -> Rays:
    """Adds a Phong lobe to vehicles' light and loses their echoes away from the normal."""
    vehicle = is_one_of(rays, VEHICLES)
    lobe = p["strength"] * jnp.exp(p["exponent"] * jnp.log(cosine(rays)))
    rays = brighten(rays, vehicle * jnp.log1p(lobe))
    return lose(rays, vehicle * p["mirror_loss"] * (1 - jnp.cos(rays.incidence_rad)))


EFFECT = Effect(
    name="specular_lobe",
    stage="surface",
    title="vehicles mirror: a bright lobe head on, losses at an angle",
    formula="vehicles: I, P *= 1 + strength · cosᵉˣᵖᵒⁿᵉⁿᵗ θ;  keep *= 1 − mirror_loss · (1 − cos θ)",
    parameters={
        "strength": Parameter(0.0, 0.0, 20.0, "", "lobe over diffuse light, head on", scale=2.0),
        "exponent": Parameter(30.0, 3.0, 200.0, "", "narrowness of the lobe", scale=20.0),
        "mirror_loss": Parameter(0.0, 0.0, 0.95, "", "share of echoes lost edge on", scale=0.4),
    },
    channels=("intensity", "drop"),
    signature="On vehicles alone: intensity peaks within some ten degrees of head on, and losses grow with the "
    "incidence angle.",
    covariates=("incidence", "class"),
    look_alikes={
        "material_dropout": "losses by class are the same at all angles",
        "incidence_cosine": "compare vehicles with walls",
        "snr_dropout": "compare angles at equal power",
        "retroreflection": "retroreflectors tolerate 40 degrees and are signs",
    },
    source="Phong, Illumination for Computer Generated Pictures, Communications of the ACM 18(6), 1975",
    apply=apply,
    starts=({"strength": 1.0}, {"mirror_loss": 0.2}, {"strength": 2.0, "exponent": 10.0, "mirror_loss": 0.2}),
)
