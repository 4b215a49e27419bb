"""Errors that the simulator has of its own: noise, lattices, or the soft contrast of a trained network.

The ideal simulator renders a class table times a cosine. The others also render the texture of surfaces (in full, or a
share of it), so that their predictions have detail within a surface and errors in it. Noise and lattices are those of
the sensor too, drawn independently: where nothing is hidden, both sides have the same statistics.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace

import numpy as np
from scipy.ndimage import gaussian_filter

from benchmarks.blind.hidden.frames import Hook, State
from benchmarks.blind.hidden.nuisance import Nuisance

UNKNOWN = 0
"""Class of a ray that the simulator loses."""
SMOOTH_CELLS = (2.0, 8.0)
"""Rows and columns over which a network's errors are alike (standard deviation of the Gaussian)."""


@dataclass(frozen=True)
class Simulator:
    """What a simulator adds to the ideal prediction; all 0 in the ideal one."""

    texture: float = 0.0
    """Share of the surfaces' texture (nats) that it renders."""
    relative_sd: float = 0.0
    """Noise of the intensity in proportion to it."""
    additive_sd: float = 0.0
    """Noise of the intensity, 0..1."""
    range_sd_m: float = 0.0
    loss: float = 0.0
    """Share of its rays that it loses."""
    step: float = 0.0
    """Of the lattice of intensities."""
    range_step_m: float = 0.0
    smooth_sd: float = 0.0
    """Errors that neighbouring rays share, nats. With these it is a conditional mean: the noise of the normals
    that it writes is not in its intensities."""

    def as_dict(self) -> dict[str, float]:
        return asdict(self)


SIMULATORS = {
    "ideal": Simulator(),
    "noisy": Simulator(1.0, relative_sd=0.06, additive_sd=0.008, range_sd_m=0.015, loss=0.01, step=1 / 255),
    "rounded": Simulator(1.0, step=1 / 255, range_step_m=0.01),
    "network": Simulator(0.5, smooth_sd=0.1),
}


def draw_simulator(name: str, rng: np.random.Generator) -> Simulator:
    """The simulator of that name; ranges of `rounded` are on millimetres or centimetres.

    Raises:
        ValueError: no such simulator.
    """
    if name not in SIMULATORS:
        raise ValueError(f"simulator {name!r} is not known; choose one of {', '.join(SIMULATORS)}")
    drawn = SIMULATORS[name]
    return replace(drawn, range_step_m=float(rng.choice([0.001, 0.01]))) if drawn.range_step_m else drawn


def sensor_like(simulator: Simulator, nuisance: Nuisance) -> Nuisance:
    """The sensor's noise where it has the simulator's statistics; a simulator without noise changes nothing."""
    if not simulator.relative_sd:
        return nuisance
    same = {"intensity_sd": simulator.relative_sd, "range_sd_m": simulator.range_sd_m, "drop": simulator.loss}
    return replace(nuisance, **same)


def floor_noise(simulator: Simulator) -> list[tuple[str, Hook]]:
    """The additive noise of the sensor, before the receiver's own effects."""

    def hook(s: State) -> None:
        noise = simulator.additive_sd * s.random("floor").normal(0, 1, s.hit.shape)
        s.intensity = np.where(s.hit, np.maximum(s.intensity + noise, 0.0), s.intensity)

    return [("receiver", hook)] if simulator.additive_sd else []


def coarser_than(simulator: Simulator, planted: tuple[str, ...]) -> Simulator:
    """The sensor's lattices: a hidden lattice takes the place of the one that both sides share."""
    step = 0.0 if "intensity_quantization" in planted else simulator.step
    return replace(simulator, step=step, range_step_m=0 if "range_quantization" in planted else simulator.range_step_m)


def on_lattice(simulator: Simulator, frame: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Range and intensity on the lattices; returns stay returns."""
    out = dict(frame)
    if simulator.step:
        out["intensity"] = np.round(frame["intensity"] / simulator.step) * simulator.step
    if step := simulator.range_step_m:
        out["range"] = np.where(frame["range"] > 0, np.maximum(np.round(frame["range"] / step), 1) * step, 0.0)
    return out


def rendered(
    simulator: Simulator, frame: dict[str, np.ndarray], rng: np.random.Generator, *, full_turn: bool
) -> dict[str, np.ndarray]:
    """The frame (`frames.simulate`) as this simulator writes it."""
    if simulator == SIMULATORS["ideal"]:
        return frame
    hit, shape = frame["range"] > 0, frame["range"].shape
    nats = simulator.texture * frame["texture"]
    if simulator.smooth_sd:
        smooth = gaussian_filter(
            rng.normal(0, 1, shape), SMOOTH_CELLS, mode=("nearest", "wrap" if full_turn else "nearest")
        )
        nats = nats + simulator.smooth_sd * smooth / smooth.std()
    shade = np.cos(frame["true_theta"]) / np.cos(frame["incidence"]) if simulator.smooth_sd else 1.0
    light = frame["intensity"] * shade * np.exp(nats + simulator.relative_sd * rng.normal(0, 1, shape))
    light = np.clip(light + simulator.additive_sd * rng.normal(0, 1, shape), 0, 1)
    range_m = frame["range"] + simulator.range_sd_m * rng.normal(0, 1, shape)
    kept = hit & (rng.random(shape) >= simulator.loss) & (range_m > 0.05)
    lost = hit & ~kept
    out = frame | {
        "range": np.where(kept, range_m, 0.0),
        "intensity": np.where(kept, light, 0.0),
        "incidence": np.where(lost, 0.0, frame["incidence"]),
        "semantic": np.where(lost, UNKNOWN, frame["semantic"]),
        "instance": np.where(lost, 0, frame["instance"]),
    }
    return on_lattice(simulator, out)
