"""Effects of the receiver, of detection and of ranging."""

from __future__ import annotations

import numpy as np
from scipy.special import ndtr

from benchmarks.blind.hidden import laws
from benchmarks.blind.hidden.frames import State, silhouette, steps
from benchmarks.blind.hidden.laws import About, fit, table
from benchmarks.blind.hidden.light import DEGREE
from benchmarks.blind.hidden.plan import Effect, Plan, as_list, at, centred, sign_of


def focal_compensation(amount: float, rng: np.random.Generator, about: About) -> Plan:
    """Counts that the firmware adds by its focal table: 40 ranges from 1 to 130 m a beam, interpolated."""
    focal = rng.uniform(4, 24, about.rows)
    knots = np.linspace(0, 131, 40)
    added = amount * 256 / 255 * np.abs((1 - focal[:, None] / 131) ** 2 - (1 - knots[None] / 131) ** 2)

    def hook(s: State) -> None:
        r = np.where(s.hit, np.minimum(s.range_m, 131), 0)
        extra = np.stack([np.interp(r[b], knots, added[b]) for b in range(len(r))])
        s.intensity = np.where(s.hit, s.intensity + extra, s.intensity)

    return at("receiver", hook, slope=amount, focal_m=as_list(focal))


def beam_gain(amount: float, rng: np.random.Generator, about: About) -> Plan:
    gain = centred(rng, about.rows, amount)
    return at("receiver", lambda s: s.scale(np.exp(gain)[:, None]), gain=as_list(gain))


def emitter_drift(amount: float, rng: np.random.Generator, about: About) -> Plan:
    """Light lost over the recording, slightly faster at first; `amount` is the loss from first to last frame."""
    total = amount * (1 if rng.random() < 0.8 else -1)
    span = max(about.minutes, 1e-6)

    def law(minutes: np.ndarray | float) -> np.ndarray:
        u = np.asarray(minutes) / span
        return -total * (1 - np.exp(-0.3 * u)) / (1 - np.exp(-0.3))

    x = np.linspace(0, span, 200)
    rate = fit(lambda t, e: -e * t, [total / span], x, law(x), True)[0]
    return at("receiver", lambda s: s.scale(np.exp(float(law(s.moment.time_s / 60)))), rate=float(rate))


def gamma_response(amount: float, rng: np.random.Generator, about: About) -> Plan:
    """Amplifier's transfer table: 12 levels over four decades with 1 % of reading error."""
    gamma = float(np.exp(amount * (-1 if rng.random() < 0.8 else 1)))
    knots = np.linspace(np.log(1e-4), 0.7, 12)
    law = table(knots, gamma * knots + rng.normal(0, 0.01, 12) * min(1, amount / 0.1))
    x = np.log(np.clip(about.intensity, 1e-4, 1))
    found = fit(lambda t, g: g * t, [gamma], x, law(x), False)[0]

    def hook(s: State) -> None:
        s.intensity = np.where(s.hit, np.exp(law(np.log(np.maximum(s.intensity, 1e-4)))), 0.0)

    return at("receiver", hook, gamma=float(found))


def intensity_offset(amount: float, rng: np.random.Generator, about: About) -> Plan:
    offset = amount * (1 if rng.random() < 0.8 else -0.3)

    def hook(s: State) -> None:
        s.intensity = np.where(s.hit, np.maximum(s.intensity + offset, 0), 0.0)

    return at("receiver", hook, offset=float(offset))


def saturation(amount: float, rng: np.random.Generator, about: About) -> Plan:
    ceiling = float(np.clip(np.quantile(about.intensity, 1 - amount), 0.02, 1.0))

    def hook(s: State) -> None:
        s.intensity = np.minimum(s.intensity, ceiling)

    return at("receiver", hook, ceiling=ceiling)


def intensity_quantization(amount: float, rng: np.random.Generator, about: About) -> Plan:
    def hook(s: State) -> None:
        s.intensity = np.round(s.intensity / amount) * amount

    return at("receiver", hook, step=amount)


def snr_dropout(amount: float, rng: np.random.Generator, about: About) -> Plan:
    """Photon statistics: a return is seen when its Gaussian-noised log amplitude passes the comparator."""
    sd = rng.uniform(0.4, 1.2)
    ln_p = np.log(np.maximum(about.power, 1e-12))
    low, high = ln_p.min() - 6, ln_p.max() + 6
    for _ in range(50):
        middle = (low + high) / 2
        low, high = (middle, high) if np.mean(ndtr((middle - ln_p) / sd)) < amount else (low, middle)

    def hook(s: State) -> None:
        s.lose(ndtr((middle - np.log(np.maximum(s.power, 1e-12))) / sd))

    x = np.linspace(middle - 4 * sd, middle + 4 * sd, 200)
    t, width = fit(
        lambda z, t, b: 1 / (1 + np.exp(-(z - t) / b)), [middle, sd / 1.7], x, ndtr((x - middle) / sd), False
    )
    return at("detection", hook, threshold=float(t), width=float(abs(width)))


def random_dropout(amount: float, rng: np.random.Generator, about: About) -> Plan:
    return at("detection", lambda s: s.lose(amount), probability=amount)


def material_dropout(amount: float, rng: np.random.Generator, about: About) -> Plan:
    """One or two classes whose surfaces swallow light (glass, black paint, wet ground)."""
    count = np.bincount(about.semantic, minlength=34)[:34]
    common = [c for c in (26, 27, 11, 21, 7, 24, 20) if count[c] > 0.005 * count.sum()]
    probability = np.zeros(34)
    for c in rng.choice(common, size=min(len(common), int(rng.integers(1, 3))), replace=False):
        probability[c] = min(0.95, amount * rng.uniform(0.8, 1.2))
    look_up = np.append(probability, np.zeros(30))
    known = [float(p) if n else None for p, n in zip(probability, count, strict=True)]
    return at("detection", lambda s: s.lose(look_up[s.semantic]), probability=known)


def beam_dropout(amount: float, rng: np.random.Generator, about: About) -> Plan:
    """One to three channels of the sensor are failing."""
    lost = np.zeros(about.rows)
    lost[rng.choice(about.rows, size=int(rng.integers(1, 4)), replace=False)] = min(1.0, amount * rng.uniform(0.9, 1.1))
    return at("detection", lambda s: s.lose(lost[:, None]), probability=as_list(lost))


def edge_dropout(amount: float, rng: np.random.Generator, about: About) -> Plan:
    def hook(s: State) -> None:
        s.lose(np.where(silhouette(s.range_m, s.grid.full_turn), amount, 0.0))

    return at("detection", hook, probability=amount)


def range_gate(amount: float, rng: np.random.Generator, about: About) -> Plan:
    """A gate a few centimetres soft, near or far, that `amount` of the returns do not pass."""
    near = rng.random() < 0.5
    low = float(min(np.quantile(about.range_m, amount), 15.0)) if near else 0.0
    high = 200.0 if near else float(max(np.quantile(about.range_m, 1 - amount), 15.0))

    def hook(s: State) -> None:
        r = np.where(s.hit, s.range_m, 10.0)
        s.lose(1 - ndtr((r - low) / 0.03) * ndtr((high - r) / 0.03))

    known = {"minimum_m": low} if near else {"maximum_m": high}
    return at("detection", hook, **known)


def _middle(rng: np.random.Generator, about: About, margin: float) -> float:
    low, high = about.edge_azimuth
    return float(rng.uniform(low + margin, high - margin))


def sector_occlusion(amount: float, rng: np.random.Generator, about: About) -> Plan:
    middle = _middle(rng, about, 0.1 + amount / 2)

    def hook(s: State) -> None:
        inside = np.abs(np.angle(np.exp(1j * (s.azimuth - middle)))) < amount / 2
        s.lose(np.where(inside, 1.0, 0.0))

    return at("detection", hook, azimuth_rad=middle, width_rad=amount)


def packet_loss(amount: float, rng: np.random.Generator, about: About) -> Plan:
    columns = int(rng.choice([2, 4, 6, 8, 12]))

    def hook(s: State) -> None:
        wide = s.hit.shape[1]
        lost = s.random("packets").random(wide // columns + 1) < amount
        s.lose(np.where(np.repeat(lost, columns)[:wide], 1.0, 0.0)[None])

    return at("detection", hook, probability=amount, columns=columns)


def ambient_light(amount: float, rng: np.random.Generator, about: About) -> Plan:
    """Sunlight from one compass direction; `bump` is a lens flare's raised cosine."""
    sun, wide, strength = rng.uniform(-np.pi, np.pi), rng.uniform(0.3, 0.7), min(0.95, amount)
    scale, width = laws.gaussian_of_bump(wide)

    def hook(s: State) -> None:
        s.lose(strength * laws.bump(s.azimuth + s.moment.heading_rad - sun, wide))

    return at("detection", hook, strength=float(strength * scale), heading_rad=float(sun), width_rad=width)


def range_noise(amount: float, rng: np.random.Generator, about: About) -> Plan:
    """Timing jitter by photon counts: variance falls as 1/P, as for the centroid of P photons of one pulse."""

    def hook(s: State) -> None:
        photons = 400 * np.maximum(s.power, 1e-5) / np.exp(-2.0)
        s.sd_m = np.hypot(s.sd_m, np.minimum(amount * np.sqrt(400 / photons), 5.0))

    return at("ranging", hook, sd_m=amount)


def range_walk(amount: float, rng: np.random.Generator, about: About) -> Plan:
    size = amount * sign_of(rng)
    reference = float(np.quantile(about.intensity, rng.uniform(0.3, 0.6)))
    x = np.clip(about.intensity, 0, 1)
    a, i = fit(lambda v, a, b: a * np.exp(-v / abs(b)), [size, reference], x, size * laws.walk_law(x, reference), False)

    def hook(s: State) -> None:
        s.bias_m = s.bias_m + size * laws.walk_law(np.clip(s.intensity, 0, 1), reference)

    return at("ranging", hook, amplitude_m=float(a), intensity=float(abs(i)))


def incidence_range_bias(amount: float, rng: np.random.Generator, about: About) -> Plan:
    part = slice(None, None, max(1, len(about.range_m) // 4000))
    r, theta = about.range_m[part], about.theta[part]
    y = laws.stretched_pulse(r, theta, amount)
    keep = y < 2.0
    found = fit(lambda x, w: 0.5 * w * x, [amount], (r * np.tan(theta))[keep], y[keep], False)[0]

    def hook(s: State) -> None:
        s.bias_m = s.bias_m + laws.stretched_pulse(np.where(s.hit, s.range_m, 0.0), s.theta, amount)

    return at("ranging", hook, divergence_rad=float(found))


def range_scale(amount: float, rng: np.random.Generator, about: About) -> Plan:
    scale = amount * sign_of(rng)

    def hook(s: State) -> None:
        s.bias_m = s.bias_m + scale * np.where(s.hit, s.range_m, 0.0)

    return at("ranging", hook, scale=scale)


def range_offset(amount: float, rng: np.random.Generator, about: About) -> Plan:
    offset = amount * sign_of(rng)

    def hook(s: State) -> None:
        s.bias_m = s.bias_m + offset

    return at("ranging", hook, offset_m=offset)


def cyclic_range_error(amount: float, rng: np.random.Generator, about: About) -> Plan:
    """Phase-measuring electronics: error periodic in range."""
    period, start = rng.uniform(2, 10), rng.uniform(0, 2 * np.pi)

    def hook(s: State) -> None:
        turns = np.where(s.hit, s.range_m, 0.0) / period
        s.bias_m = s.bias_m + amount * np.sin(2 * np.pi * turns + start)

    parts = {"sine_m": amount * float(np.cos(start)), "cosine_m": amount * float(np.sin(start))}
    return at("ranging", hook, **parts, cycles_per_m=1 / period)


def beam_range_bias(amount: float, rng: np.random.Generator, about: About) -> Plan:
    bias = centred(rng, about.rows, amount)

    def hook(s: State) -> None:
        s.bias_m = s.bias_m + bias[:, None]

    return at("ranging", hook, bias_m=as_list(bias))


def mixed_pixels(amount: float, rng: np.random.Generator, about: About) -> Plan:
    """The footprint straddles a silhouette: a share w of the beam passes on to the surface behind, w uniform."""
    p = min(1.0, amount)

    def hook(s: State) -> None:
        ahead = steps(s.range_m, s.grid.full_turn)[:2]
        ahead = np.where(np.isfinite(ahead) & (ahead > 0.3), ahead, 0.0)
        rng = s.random("straddle")
        both = (ahead > 0).all(0)
        side = np.where(both, rng.random(s.hit.shape) < 0.5, ahead[1] > 0)
        gap = np.where(side, ahead[1], ahead[0])
        w = rng.random((7, *s.hit.shape))[0]
        straddles = (rng.random(s.hit.shape) < p) & s.hit
        s.bias_m = s.bias_m + np.where(straddles, w * gap, 0.0)

    return at("ranging", hook, probability=p)


def range_quantization(amount: float, rng: np.random.Generator, about: About) -> Plan:
    def hook(s: State) -> None:
        s.round_m = amount

    return at("ranging", hook, step_m=amount)


LEVEL, DROP, RANGE = ("intensity",), ("drop",), ("range",)
ELECTRONICS = {
    "focal_compensation": Effect(focal_compensation, LEVEL, "slope", 0.03, 2.0),
    "beam_gain": Effect(beam_gain, LEVEL, "nats sd over beams", 0.03, 0.5),
    "emitter_drift": Effect(emitter_drift, LEVEL, "nats from first to last frame", 0.06, 3.0),
    "gamma_response": Effect(gamma_response, LEVEL, "absolute ln gamma", 0.056, 0.69),
    "intensity_offset": Effect(intensity_offset, LEVEL, "offset", 0.005, 0.15),
    "saturation": Effect(saturation, LEVEL, "share of returns at the ceiling", 0.02, 0.5),
    "intensity_quantization": Effect(intensity_quantization, LEVEL, "step", 0.004, 0.1),
    "snr_dropout": Effect(snr_dropout, DROP, "share of returns lost", 0.02, 0.6),
    "random_dropout": Effect(random_dropout, DROP, "probability", 0.0125, 0.9),
    "material_dropout": Effect(material_dropout, DROP, "probability", 0.1, 0.95),
    "beam_dropout": Effect(beam_dropout, DROP, "probability", 0.05, 1.0),
    "edge_dropout": Effect(edge_dropout, DROP, "probability", 0.05, 0.95),
    "range_gate": Effect(range_gate, DROP, "share of returns gated", 0.01, 0.5),
    "sector_occlusion": Effect(sector_occlusion, DROP, "rad of width", 2 * DEGREE, 1.2),
    "packet_loss": Effect(packet_loss, DROP, "probability", 0.0125, 0.5),
    "ambient_light": Effect(ambient_light, DROP, "strength", 0.06, 0.95),
    "range_noise": Effect(range_noise, RANGE, "m sd at the reference power", 0.0025, 0.3),
    "range_walk": Effect(range_walk, RANGE, "m", 0.01, 0.3),
    "incidence_range_bias": Effect(incidence_range_bias, RANGE, "rad of divergence", 0.0005, 0.02),
    "range_scale": Effect(range_scale, RANGE, "scale", 0.0005, 0.02),
    "range_offset": Effect(range_offset, RANGE, "m", 0.01, 0.5),
    "cyclic_range_error": Effect(cyclic_range_error, RANGE, "m", 0.015, 0.3),
    "beam_range_bias": Effect(beam_range_bias, RANGE, "m sd over beams", 0.01, 0.12),
    "mixed_pixels": Effect(mixed_pixels, RANGE, "probability", 0.06, 1.0),
    "range_quantization": Effect(range_quantization, RANGE, "m", 0.02, 0.5),
}
