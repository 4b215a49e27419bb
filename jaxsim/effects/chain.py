"""A sensor model: effects with their parameters, applied to rays in physical order; read from and written to
sensor.json."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import jax
import numpy as np

from jaxsim.effects import EFFECTS, get_effect
from jaxsim.effects.draw import sample
from jaxsim.effects.effect import Effect, Law, check_bounds, check_names, wrong_length
from jaxsim.effects.rays import Array, Rays, Scan, all_rays
from jaxsim.effects.recast import recast
from jaxsim.files import replacing
from jaxsim.frame import PolarImage

Value = float | tuple[float, ...]
"""Of a parameter: a number, or one a beam or class."""


@partial(jax.jit, static_argnames="effects")
def apply_effects(effects: tuple[Effect, ...], values: tuple[dict[str, Array], ...], rays: Rays, scan: Scan) -> Rays:
    """Applies effects one after the other, each with its arrays of parameters; differentiable in these."""
    for effect, given in zip(effects, values, strict=True):
        rays = apply_law(effect, given, rays, scan)
    return rays


def apply_law(law: Law, p: dict[str, Array], rays: Rays, scan: Scan) -> Rays:
    """Applies one law; rays that it sends elsewhere meet the surfaces of the scan that are there."""
    after = law.apply(p, rays)
    return recast(after, scan, law.casts) if law.casts else after


@dataclass(frozen=True)
class SensorModel:
    """What the simulator leaves out, as (name, parameters) of effects; brought into physical order.

    Parameters that are not given are neutral; one number stands for all beams or classes. Raises ValueError for
    unknown effects and parameters and for values out of bounds.
    """

    effects: tuple[tuple[str, Mapping[str, Any]], ...] = ()
    """Names and values by parameter; values are kept as floats and tuples."""

    def __post_init__(self) -> None:
        checked = tuple((name, _checked(get_effect(name), parameters)) for name, parameters in self.effects)
        order = list(EFFECTS)
        object.__setattr__(self, "effects", tuple(sorted(checked, key=lambda entry: order.index(entry[0]))))

    def values(self, rows: int) -> tuple[dict[str, Array], ...]:
        """Each effect's parameters as arrays for a sensor of so many beams.

        Raises ValueError for vectors that do not fit it.
        """
        return tuple(get_effect(name).values(parameters, rows) for name, parameters in self.effects)

    def apply(self, rays: Rays, scan: Scan) -> Rays:
        """What becomes of rays of this scan: expectations and probabilities, nothing drawn yet."""
        chain = tuple(get_effect(name) for name, _ in self.effects)
        return apply_effects(chain, self.values(scan.range_m.shape[1]), rays, scan)

    def sample(self, key: Array, rays: Rays, *, noise_m: float = 0.0, noise: float = 0.0) -> PolarImage:
        """Draws whole images (*b, rows, columns) of rays to which the effects were applied.

        `noise_m` is the sensor's own standard deviation of range, `noise` that of the log intensity.
        """
        default = get_effect("packet_loss").parameters["columns"].neutral
        groups = [np.asarray(p.get("columns", default)) for name, p in self.effects if name == "packet_loss"]
        return sample(key, rays, noise_m=noise_m, noise=noise, columns=round(groups[0].item()) if groups else 1)

    def simulate(self, scan: Scan, key: Array, *, noise_m: float = 0.0, noise: float = 0.0) -> PolarImage:
        """All frames of a scan as the sensor reports them (host memory); frame k depends on the key and k alone."""
        images = []
        for k in range(scan.range_m.shape[0]):
            # One frame at a time: the rays of a whole recording would not fit into memory.
            one = frame_of(scan, k)
            rays = self.apply(_all_rays(one), one)
            image = self.sample(jax.random.fold_in(key, k), rays, noise_m=noise_m, noise=noise)
            images.append(jax.device_get(image))
        return jax.tree.map(lambda *frames: np.concatenate(frames), *images)

    def save(self, path: Path | str) -> None:
        """Writes sensor.json."""
        entries = [
            {"name": name, "parameters": {p: list(v) if isinstance(v, tuple) else v for p, v in parameters.items()}}
            for name, parameters in self.effects
        ]
        with replacing(path) as temporary:
            temporary.write_text(json.dumps({"effects": entries}, indent=1) + "\n")

    @classmethod
    def load(cls, path: Path | str, rows: int | None = None) -> SensorModel:
        """The sensor model of a sensor.json; `rows` are the beams of the sensor that it is to fit.

        Raises ValueError where the file is none, names what is not known or does not fit.
        """
        path = Path(path)
        if not path.is_file():
            raise ValueError(f"sensor: no file {path}; `jaxsim discover` writes one as OUT/sensor.json")
        try:
            content = json.loads(path.read_text())
            entries = [(entry["name"], {**entry.get("parameters", {})}) for entry in content["effects"]]
        except (json.JSONDecodeError, UnicodeDecodeError, KeyError, TypeError, AttributeError) as error:
            raise ValueError(
                f'sensor: {path} is not {{"effects": [{{"name": ..., "parameters": {{...}}}}, ...]}} ({error!r})'
            ) from error
        try:
            model = cls(tuple(entries))
            if rows is not None:
                model.values(rows)
        except ValueError as error:
            raise ValueError(f"sensor: {path}: {error}") from error
        return model


_all_rays = jax.jit(all_rays)


def frame_of(scan: Scan, k: int) -> Scan:
    """One frame of a scan, as a scan."""
    grid = scan.grid
    return replace(jax.tree.map(lambda leaf: leaf[k : k + 1], replace(scan, grid=None)), grid=grid)


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
