"""HELIOS++: attributes of a scanner in its XML.

accuracy_m is the deviation of a Gaussian error of the range; the visibility makes the attenuation of the air after
Carlsson et al. (2001), which depends on the wavelength. Sources: https://github.com/3dgeo-heidelberg/helios/wiki/Scanners
and the scanner page of its documentation.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from jaxsim.engines.engine import OF_SURFACES, Engine, Estimates, Setting, known, limits_of_range, noise_of_range

_MATERIAL = (
    "reflection is of the scene's materials (.mtl: helios_reflectance, and its Phong terms): change these for the "
    "surfaces concerned"
)
_CONTRAST = 0.02
"""Contrast at which Koschmieder's visibility ends in HELIOS++: attenuation is 3.91 over it, and 3.91 = -ln 0.02."""
INSTEAD = {
    **dict.fromkeys(OF_SURFACES, _MATERIAL),
    "random_dropout": "no return is lost but by its energy; thin the points behind it",
    "random_loss": "no return is lost but by its energy; thin the points behind it",
    "range_falloff": "its intensity is received power, which falls as the laser equation says; undo that in the points "
    "where the sensor's firmware does",
    "mixed_pixels": "beamSampleQuality above 1 casts several rays a pulse, and the waveform's peaks lie between "
    "surfaces that are closer than the pulse is long",
    "beam_azimuth_error": "a multi-scanner has its channels one by one: give each its own rotation",
    "beam_elevation_error": "a multi-scanner has its channels one by one: give each its own rotation",
    "motion_distortion": "a platform that moves while the scanner turns has it already",
}


def settings(answer: Estimates, _: Mapping[str, float]) -> list[Setting]:
    """Attributes of <scanner>."""
    divergence = answer.one("incidence_range_bias", "divergence_rad")
    extinction = answer.one("atmospheric_extinction", "coefficient_per_m")
    visibility = None
    if extinction is not None and extinction.value > 0:
        visibility = extinction.mapped(lambda alpha: -math.log(_CONTRAST) / alpha / 1000 if alpha > 0 else math.inf)
    why = "atmospheric_extinction: 3.91 / α at 550 nm; HELIOS++ scales it to the wavelength"
    return [
        *noise_of_range(answer, "accuracy_m"),
        *known(("beamDivergence_rad", divergence, "rad", "incidence_range_bias: the beam's divergence")),
        *known(("atmosphericVisibility_km", visibility, "km", why)),
        *limits_of_range(answer, minimum="rangeMin_m", maximum="rangeMax_m"),
    ]


def text(chosen: Sequence[Setting]) -> str:
    """The attributes as XML."""
    attributes = "".join(f' {one.name}="{one.value.value:.6g}"' for one in chosen)
    return f"<scanner{attributes}/>\n"


ENGINE = Engine(
    title="HELIOS++",
    settings=settings,
    expresses=frozenset({"range_noise", "incidence_range_bias", "atmospheric_extinction", "range_gate"}),
    instead=INSTEAD,
    clearer="the frames that were compared have haze that the street had not: raise their atmosphericVisibility_km",
    text=text,
    suffix=".xml",
    notes=(
        "Compare with a survey of accuracy_m 0, and with intensities on one scale: HELIOS++ writes received power.",
    ),
    links=("https://github.com/3dgeo-heidelberg/helios/wiki/Scanners", "https://github.com/3dgeo-heidelberg/helios"),
)
