"""A sensor model: effects with their parameters, applied to rays in physical order, and one draw of what the sensor
then reports; read from and written to sensor.json."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from jaxsim.effects import EFFECTS, get_effect
from jaxsim.effects.edits import clutter_range, lose
from jaxsim.effects.effect import Effect, Law, check_bounds, check_names, wrong_length
from jaxsim.effects.learned import Learned
from jaxsim.effects.origin import check_origin, origin_of
from jaxsim.effects.places import all_rays
from jaxsim.effects.rays import CLUTTER_REACH_M, FLOOR, Array, Rays, Scan
from jaxsim.effects.recast import recast
from jaxsim.effects.region import Region, kept
from jaxsim.files import check_keys, placed, read_json, real, repeated, write_text
from jaxsim.frame import PolarImage

LEVELS = {
    "range_noise": 10.0,
    "intensity_noise": 1.0,
    "intensity_noise_constant": 1.0,
    "random_loss": 0.99,
    "intensity_step": 0.5,
    "range_step": 10.0,
}
"""Levels of a sensor, and the most that each may be: m, share, 0..1, probability, 0..1, m."""
NOTHING = 1.01 * FLOOR
"""Intensity up to which a reading is 0: its logarithm cannot tell it from one."""
Value = float | tuple[float, ...]
"""Value of a parameter: a number, or one a beam or class."""


@partial(jax.jit, static_argnames="effects")
def apply_effects(
    effects: tuple[Effect, ...],
    values: tuple[dict[str, Array], ...],
    rays: Rays,
    *,
    scan: Scan,
    inside: Mapping[str, Bool[Array, "*n"]] | None = None,
) -> Rays:
    """Applies effects one after the other, each with its arrays of parameters; differentiable in these. `inside` gives
    by name the rays on which an effect acts, if not on all."""
    for effect, given in zip(effects, values, strict=True):
        after = apply_law(effect, given, rays, scan=scan)
        rays = kept(inside[effect.name], rays, after) if inside and effect.name in inside else after
    return rays


def apply_law(law: Law, p: dict[str, Array], rays: Rays, *, scan: Scan) -> Rays:
    """Applies one law; rays that it sends elsewhere meet the surfaces of the scan that are there."""
    after = law.apply(p, rays)
    return recast(after, scan, law.casts) if law.casts else after


@partial(jax.jit, static_argnames="columns")
def sample(
    key: Array,
    rays: Rays,
    *,
    noise_m: float | Array = 0.0,
    noise: float | Array = 0.0,
    constant: float | Array = 0.0,
    columns: int = 1,
) -> PolarImage:
    """Draws what is reported of whole images (*b, rows, columns) of rays.

    In turn: a group of `columns` columns may be lost with all its returns. Else a ray may return early (clutter),
    else a bright target's glare (ghost), else, if it hits and its echo is kept, the surface; at an edge that reading
    may lie between two surfaces. Glare of rays that hit nothing has the intensity of clutter. Then noise, the
    ceiling, rounding. `noise_m` is the sensor's own standard deviation of range, `noise` that of the log intensity,
    `constant` that of intensity noise that is the same for all.
    """
    keys = jax.random.split(key, 9)
    shape = rays.range_m.shape

    def chance(k: int) -> Array:
        return jax.random.uniform(keys[k], shape)

    end_m = jnp.where(rays.hit, jnp.minimum(rays.range_m, CLUTTER_REACH_M), CLUTTER_REACH_M)
    # Nine keys, one a draw, so that no draw depends on what another decides.
    early = (chance(0) < rays.clutter) & (end_m > rays.clutter_from_m)
    glare = (chance(1) < rays.ghost) & ~early
    # In logarithms: probabilities near 1 would be rounded to it. 0 is certain, whatever is drawn.
    surface = (jnp.log(jnp.maximum(chance(2), 1e-30)) < rays.log_keep) | (rays.log_keep >= 0)
    surface = surface & rays.hit & ~early & ~glare
    mixed = chance(3) < rays.between
    share = jnp.where(mixed, chance(4), jnp.zeros(shape))
    reading = rays.reading_m + share * (rays.between_m - rays.reading_m)
    reading = jnp.where(glare, rays.ghost_m, reading)
    reading = jnp.where(early, clutter_range(chance(5), rays, end_m), reading)
    # Independent noises: their variances add up.
    spread = jnp.sqrt(jnp.square(rays.noise_m) + jnp.square(jnp.asarray(noise_m, jnp.float32)))
    reading = _rounded(reading + spread * jax.random.normal(keys[6], shape), rays.range_step_m)

    # What comes of no surface has no surface's intensity.
    false = early | (glare & ~rays.hit)
    log_intensity = jnp.where(false, rays.clutter_log_intensity, rays.log_intensity)
    log_intensity = log_intensity + jnp.asarray(noise, jnp.float32) * jax.random.normal(keys[7], shape)
    # The last key's other half, so that models without levels draw what they always drew.
    constant_noise = constant * jax.random.normal(jax.random.fold_in(keys[7], 1), shape)
    received = jnp.minimum(jnp.exp(log_intensity) + constant_noise, rays.intensity_top)
    # Darker than the floor of logarithms is what was read as nothing.
    received = jnp.where(received > NOTHING, received, jnp.zeros_like(received))
    intensity = _rounded(received, rays.intensity_step)
    # After rounding: a multiple of the step may lie beyond the ceiling and the scale.
    intensity = jnp.clip(intensity, 0.0, jnp.minimum(rays.intensity_top, 1.0))

    groups = -(-shape[-1] // columns)
    luck = jax.random.uniform(keys[8], (*shape[:-2], 1, groups))
    # A packet holds neighbouring columns, all rows of them: one draw for all.
    lost = jnp.repeat(luck, columns, axis=-1)[..., : shape[-1]] < rays.column_loss
    valid = (surface | glare | early) & ~lost & (reading > 0)
    return PolarImage(jnp.where(valid, reading, 0.0), jnp.where(valid, intensity, 0.0), valid)


def _rounded(value: Float[Array, "*n"], step: Float[Array, ""]) -> Float[Array, "*n"]:
    """The value rounded to multiples of the step; a step of 0 leaves it."""
    safe = jnp.where(step > 0, step, 1.0)
    return jnp.where(step > 0, jnp.round(value / safe) * safe, value)


@dataclass(frozen=True)
class SensorModel:
    """What the simulator leaves out, as (name, parameters) of effects; brought into physical order.

    Parameters that are not given are neutral; one number stands for all beams or classes. Raises ValueError for
    unknown effects and parameters and for values out of bounds.
    """

    effects: tuple[tuple[str, Mapping[str, Any]], ...] = ()
    """Names and values by parameter; values are kept as floats and tuples."""
    levels: Mapping[str, float] = field(default_factory=dict)
    """Noise and losses of the sensor that no effect explains, by the names of LEVELS; drawn with all that is drawn."""
    learned: tuple[Learned, ...] = ()
    """What no effect describes; acts after all effects, in this order."""
    regions: Mapping[str, Region] = field(default_factory=dict)
    """The region where each effect acts, by name, if not everywhere."""

    def __post_init__(self) -> None:
        checked = tuple((name, _checked(get_effect(name), parameters)) for name, parameters in self.effects)
        # Physical order, whatever the file says: light meets the surface before it meets the receiver.
        order = list(EFFECTS)
        for name, value in self.levels.items():
            if name not in LEVELS:
                raise ValueError(f"levels: {name!r} is not known; known are {', '.join(LEVELS)}")
            if not 0 <= value <= LEVELS[name]:
                raise ValueError(f"levels: {name} is {value:g}; it must lie within 0 and {LEVELS[name]:g}")
        for name in self.regions:
            if name not in {effect for effect, _ in checked} or get_effect(name).of_recording:
                whole = ", ".join(name for name, effect in EFFECTS.items() if effect.of_recording)
                raise ValueError(f"where: {name} has no part; it may be given for effects of the model but {whole}")
        object.__setattr__(self, "effects", tuple(sorted(checked, key=lambda entry: order.index(entry[0]))))

    @property
    def names(self) -> tuple[str, ...]:
        """Its effects and learned laws, in the order in which they act."""
        return (*(name for name, _ in self.effects), *(law.name for law in self.learned))

    def beside(self, other: SensorModel) -> SensorModel:
        """This model, with those effects of another that it lacks."""
        mine = dict(self.effects)
        theirs = tuple(pair for pair in other.effects if pair[0] not in mine)
        regions = {name: other.regions[name] for name, _ in theirs if name in other.regions}
        return replace(self, effects=(*self.effects, *theirs), regions={**self.regions, **regions})

    def without(self, other: SensorModel) -> SensorModel:
        """This model without effects that stand in another with the same values, in the same region."""
        left = tuple(
            pair
            for pair in self.effects
            if pair not in other.effects or self.regions.get(pair[0]) != other.regions.get(pair[0])
        )
        regions = {name: self.regions[name] for name, _ in left if name in self.regions}
        return replace(self, effects=left, regions=regions)

    def values(self, rows: int) -> tuple[dict[str, Array], ...]:
        """Each effect's parameters as arrays for a sensor of so many beams.

        Raises ValueError for vectors that do not fit it.
        """
        return tuple(get_effect(name).values(parameters, rows) for name, parameters in self.effects)

    def apply(self, rays: Rays, scan: Scan) -> Rays:
        """What becomes of rays of this scan: expectations and probabilities, nothing drawn yet."""
        chain = tuple(get_effect(name) for name, _ in self.effects)
        inside = {name: region.holds(rays, scan) for name, region in self.regions.items()}
        rays = apply_effects(chain, self.values(scan.range_m.shape[1]), rays, scan=scan, inside=inside)
        for law in self.learned:
            rays = law.apply(rays)
        return rays

    def sample(self, key: Array, rays: Rays) -> PolarImage:
        """Draws whole images (*b, rows, columns) of rays to which the effects were applied, with the model's levels."""
        levels = {name: float(self.levels.get(name, 0.0)) for name in LEVELS}
        if levels["random_loss"]:
            rays = lose(rays, jnp.full_like(rays.log_keep, levels["random_loss"]))
        rays = replace(
            rays,
            # Rounded twice is rounded to the coarser of both steps, as far as anybody can see.
            intensity_step=jnp.maximum(rays.intensity_step, levels["intensity_step"]),
            range_step_m=jnp.maximum(rays.range_step_m, levels["range_step"]),
        )
        default = get_effect("packet_loss").parameters["columns"].neutral
        groups = [float(p.get("columns", default)) for name, p in self.effects if name == "packet_loss"]
        return sample(
            key,
            rays,
            noise_m=levels["range_noise"],
            noise=levels["intensity_noise"],
            constant=levels["intensity_noise_constant"],
            columns=round(groups[0]) if groups else 1,
        )

    def simulate(self, scan: Scan, key: Array) -> PolarImage:
        """All frames of a scan as the sensor reports them (host memory); frame k depends on the key and k alone."""
        images = []
        for k in range(scan.range_m.shape[0]):
            # One frame at a time: the rays of a whole recording would not fit into memory.
            one = frame_of(scan, k)
            rays = self.apply(_all_rays(one), one)
            images.append(jax.device_get(self.sample(jax.random.fold_in(key, k), rays)))
        return jax.tree.map(lambda *frames: np.concatenate(frames), *images)

    def optional(self) -> dict[str, Any]:
        """Levels (`levels`), learned laws (`learned`), and by name the parts where effects act (`where`) and from where
        effects of one's own come (`own`), as plain values; keys only where there are some, so that files of models
        without them stay as they were."""
        levels = {"levels": dict(self.levels)} if self.levels else {}
        origins = {name: origin for name, _ in self.effects if (origin := origin_of(name))}
        own = {"own": origins} if origins else {}
        learned = {"learned": [law.to_json() for law in self.learned]} if self.learned else {}
        where = {"where": {name: region.to_json() for name, region in self.regions.items()}} if self.regions else {}
        return levels | own | learned | where

    def save(self, path: Path | str) -> None:
        """Writes sensor.json."""
        optional = self.optional()
        # In the file a part and an origin stand with their effect.
        where, own = optional.pop("where", {}), optional.pop("own", {})
        entries = [
            {"name": name, "parameters": {p: list(v) if isinstance(v, tuple) else v for p, v in parameters.items()}}
            | ({"from": own[name]} if name in own else {})
            | ({"where": where[name]} if name in where else {})
            for name, parameters in self.effects
        ]
        write_text(path, json.dumps({"effects": entries} | optional, indent=1) + "\n")

    @classmethod
    def load(cls, path: Path | str, rows: int | None = None) -> SensorModel:
        """The sensor model of a sensor.json; `rows` are the beams of the sensor that it is to fit.

        Loads no code: an effect of one's own must be known by then (`own.known_effects`). Raises ValueError where the
        file is none, names what is not known, or comes from elsewhere, or does not fit.
        """
        path = Path(path)
        if not path.is_file():
            raise ValueError(f"sensor: no file {path}; `jaxsim discover` writes one as OUT/sensor.json")
        content = read_json(path, by="sensor")
        form = '{"effects": [{"name": ..., "parameters": {...}}, ...]}'
        with placed(f"sensor: {path} is not {form}", KeyError, TypeError, AttributeError):
            check_keys(content, ("effects", "levels", "learned"), where="sensor.json")
            for entry in content["effects"]:
                check_keys(entry, ("name", "parameters", "from", "where"), where=f"effect {entry['name']}")
            entries = [(entry["name"], _plain(entry.get("parameters", {}))) for entry in content["effects"]]
            levels = {name: real(value) for name, value in content.get("levels", {}).items()}
            twice = repeated(name for name, _ in entries)
            origins = {entry["name"]: entry.get("from") for entry in content["effects"]}
            laws = list(content.get("learned", []))
            parts = {entry["name"]: entry["where"] for entry in content["effects"] if "where" in entry}
        if twice:
            raise ValueError(
                f"sensor: {path} lists {twice[0]} more than once; an effect stands once, with one `where`: keep one, "
                "or write an effect of your own for the other (`jaxsim effects new`)"
            )
        with placed(f"sensor: {path}"):
            for name, origin in origins.items():
                check_origin(name, origin)
            regions = {name: Region.from_json(part) for name, part in parts.items()}
            model = cls(tuple(entries), levels, tuple(map(Learned.from_json, laws)), regions)
            if rows is not None:
                model.values(rows)
                for law in model.learned:
                    law.check_rows(rows)
        return model


_all_rays = jax.jit(all_rays)


def frame_of(scan: Scan, k: int) -> Scan:
    """One frame of a scan, as a scan."""
    grid = scan.grid
    return replace(jax.tree.map(lambda leaf: leaf[k : k + 1], replace(scan, grid=None)), grid=grid)


def _plain(parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Parameters as JSON has them. Raises ValueError for what is neither a number nor a list of numbers."""
    return {name: [*map(real, value)] if isinstance(value, list) else real(value) for name, value in parameters.items()}


def _checked(effect: Effect, parameters: Mapping[str, Any]) -> dict[str, Value]:
    """The parameters as plain numbers and tuples. Raises ValueError for names, bounds and lengths that cannot be
    right."""
    check_names(effect, parameters)
    result: dict[str, Value] = {}
    for name, given in parameters.items():
        try:
            value = np.asarray(given, np.float64)
        except (TypeError, ValueError) as error:
            raise ValueError(f"{effect.name}: {name} is {given!r}; give a number or a list of numbers") from error
        shape = effect.parameters[name].shape
        if value.ndim > 1 or (value.ndim and (shape == "scalar" or value.shape[0] == 0)):
            raise ValueError(wrong_length(effect, name, value.shape, rows=0 if shape == "row" else 1))
        if value.ndim and shape == "class":
            effect.values({name: value}, rows=1)
        for number in value.ravel().tolist():
            check_bounds(effect, name, number)
        result[name] = tuple(value.tolist()) if value.ndim else float(value)
    return result
