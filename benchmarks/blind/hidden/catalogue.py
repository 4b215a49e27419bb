"""What can be hidden: every effect of the catalogue, kinds from outside it, combinations; and how large a unit is."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.blind.hidden.electronics import ELECTRONICS
from benchmarks.blind.hidden.light import LIGHT
from benchmarks.blind.hidden.outside import OUTSIDE
from benchmarks.blind.hidden.plan import Effect, Maker

EFFECTS: dict[str, Effect] = {**LIGHT, **ELECTRONICS}
UNITS_FILE = Path(__file__).with_name("units.json")
STAGE_ORDER = {name: n for n, name in enumerate(EFFECTS)}

# Members of a family act on the same covariate of the same channel; a combination takes at most one of each.
FAMILIES = {
    "angle": ("incidence_cosine", "oren_nayar", "specular_lobe", "gamma_response", "intensity_offset", "saturation"),
    "distance": ("range_falloff", "atmospheric_extinction", "near_range_overlap", "focal_compensation", "range_gate"),
    "beam": ("beam_gain",),
    "pose": (
        "extrinsic_rotation",
        "extrinsic_translation",
        "beam_elevation_error",
        "beam_azimuth_error",
        "motion_distortion",
    ),
    "ranging": (
        "beam_range_bias",
        "range_scale",
        "range_offset",
        "range_walk",
        "incidence_range_bias",
        "range_noise",
        "cyclic_range_error",
    ),
    "edge": ("mixed_pixels", "edge_dropout", "blooming"),
    "clutter": ("fog_backscatter", "precipitation_clutter", "interference"),
    "sector": ("window_contamination", "sector_occlusion", "ambient_light"),
    "chance": ("random_dropout", "packet_loss", "material_dropout", "beam_dropout", "snr_dropout"),
    "lattice": ("intensity_quantization",),
    "grid": ("range_quantization",),
    "time": ("emitter_drift",),
    "bright": ("retroreflection",),
}

# Where the disagreement may rightly be said to lie, for the scorer.
RANGES, ANGLES = ("range", "power"), ("incidence",)
BEAMS, TURNS, EDGES = ("row", "elevation"), ("azimuth", "column", "heading"), ("step", "edge", "depth_step")
LEVELS, KINDS, TIMES = ("intensity", "power", "reflectance"), ("class", "semantic", "instance"), ("time", "frame")
COVARIATES: dict[str, tuple[str, ...]] = {
    "extrinsic_rotation": (*BEAMS, *TURNS, *EDGES, "range"),
    "extrinsic_translation": (*BEAMS, *TURNS, *EDGES, "range", *ANGLES),
    "beam_elevation_error": BEAMS,
    "beam_azimuth_error": (*BEAMS, *EDGES, "range"),
    "motion_distortion": ("speed", *TURNS, *EDGES, "time"),
    "incidence_cosine": ANGLES,
    "oren_nayar": ANGLES,
    "specular_lobe": (*ANGLES, *KINDS),
    "retroreflection": (*KINDS, *ANGLES),
    "range_falloff": RANGES,
    "atmospheric_extinction": RANGES,
    "near_range_overlap": (*RANGES, *BEAMS),
    "window_contamination": TURNS,
    "blooming": (*EDGES, *KINDS, *LEVELS),
    "fog_backscatter": ("range",),
    "precipitation_clutter": ("range",),
    "interference": ("range",),
    "focal_compensation": (*BEAMS, *RANGES),
    "beam_gain": BEAMS,
    "emitter_drift": TIMES,
    "gamma_response": (*LEVELS, *ANGLES, *KINDS),
    "intensity_offset": (*LEVELS, *ANGLES, *KINDS),
    "saturation": (*LEVELS, *KINDS, *ANGLES),
    "intensity_quantization": LEVELS,
    "snr_dropout": (*LEVELS, *RANGES, *ANGLES),
    "random_dropout": (),
    "material_dropout": KINDS,
    "beam_dropout": BEAMS,
    "edge_dropout": EDGES,
    "range_gate": RANGES,
    "sector_occlusion": TURNS,
    "packet_loss": ("column", *TIMES, "azimuth"),
    "ambient_light": (*TURNS, *TIMES),
    "range_noise": (*LEVELS, *RANGES),
    "range_walk": LEVELS,
    "incidence_range_bias": (*ANGLES, "range"),
    "range_scale": ("range",),
    "range_offset": (),
    "cyclic_range_error": ("range",),
    "beam_range_bias": BEAMS,
    "mixed_pixels": EDGES,
    "range_quantization": ("range",),
}


class Choice(NamedTuple):
    """What a case hides: names from the catalogue, or one from outside, or nothing."""

    effects: tuple[str, ...] = ()
    outside: str | None = None


def list_effects() -> list[str]:
    """Names of the catalogue, in physical order."""
    return list(EFFECTS)


def list_outside() -> list[str]:
    """Names of the kinds that the catalogue lacks (without the 'outside:' that `choose` wants before them)."""
    return list(OUTSIDE)


def list_combinations(size: int, count: int, seed: int) -> list[tuple[str, ...]]:
    """`count` different sets of `size` effects that differ physically: no two of one family, rare ones first.

    Raises:
        ValueError: there are not so many.
    """
    rng = np.random.default_rng([seed, size])
    used = dict.fromkeys(EFFECTS, 0)
    out: list[tuple[str, ...]] = []
    families = list(FAMILIES.values())
    for _ in range(200 * count if size <= len(families) else 0):
        picked = []
        for family in rng.permutation(len(families))[:size]:
            rare = min(used[n] for n in families[family])
            picked.append(str(rng.choice([n for n in families[family] if used[n] == rare])))
        names = tuple(sorted(picked, key=STAGE_ORDER.__getitem__))
        if names not in out:
            out.append(names)
            for n in names:
                used[n] += 1
        if len(out) == count:
            return out
    raise ValueError(f"{count} combinations of {size} effects are too many; ask for fewer ({len(families)} families)")


def choose(effect: str | list[str] | tuple[str, ...] | None, rng: np.random.Generator) -> Choice:
    """Read 'none', NAME, 'A+B', 'outside:NAME', 'random' (0.2 none, 0.6 one, 0.1 two, 0.1 outside) or a list of names.

    Raises:
        ValueError: a name is not known; the message lists the known ones.
    """
    if effect is None or effect == "none" or effect == [] or effect == ():
        return Choice()
    if effect == "random":
        draw = rng.random()
        if draw < 0.2:
            return Choice()
        if draw < 0.8:
            return Choice((str(rng.choice(list(EFFECTS))),))
        if draw < 0.9:
            return Choice(list_combinations(2, 1, int(rng.integers(1 << 31)))[0])
        return Choice(outside=str(rng.choice(list(OUTSIDE))))
    if isinstance(effect, str) and effect.startswith("outside:"):
        name = effect.removeprefix("outside:")
        if name not in OUTSIDE:
            raise ValueError(f"outside:{name} is not known; choose one of {', '.join(OUTSIDE)}")
        return Choice(outside=name)
    names = tuple(effect.split("+")) if isinstance(effect, str) else tuple(effect)
    for name in names:
        if name not in EFFECTS:
            known = ", ".join(EFFECTS)
            raise ValueError(f"effect {name!r} is not known; choose none, random, outside:NAME or one of {known}")
    if len(set(names)) < len(names):
        raise ValueError(f"an effect is given twice in {'+'.join(names)}; give each once")
    return Choice(tuple(sorted(names, key=STAGE_ORDER.__getitem__)))


def floor_of(name: str) -> float:
    """Smallest amount that matters to an engineer; of an effect or a kind from outside."""
    return EFFECTS[name].floor if name in EFFECTS else OUTSIDE[name].floor


def cap_of(name: str) -> float:
    """Largest amount that makes sense."""
    return EFFECTS[name].cap if name in EFFECTS else OUTSIDE[name].cap


def maker_of(name: str) -> Maker:
    return EFFECTS[name].make if name in EFFECTS else OUTSIDE[name].make


def unit_of(name: str) -> float:
    """Amount at severity 1: the committed table's; the minimal relevant size where that has no row."""
    row = _table().get(name)
    return float(row["unit"]) if row else floor_of(name)


@cache
def _table() -> dict[str, dict]:
    return json.loads(UNITS_FILE.read_text())["units"] if UNITS_FILE.exists() else {}


def amount_of(name: str, severity: float) -> float:
    """Severity times the unit, up to what the effect can bear."""
    return min(severity * unit_of(name), cap_of(name))
