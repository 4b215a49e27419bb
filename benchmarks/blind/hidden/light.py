"""Effects on the rays, the surface and the path."""

from __future__ import annotations

import numpy as np

from benchmarks.blind.hidden import laws
from benchmarks.blind.hidden.frames import SCAN_S, Grid, Moment, Rays, State, _turn
from benchmarks.blind.hidden.laws import About, fit, table
from benchmarks.blind.hidden.plan import Effect, Plan, as_list, at, centred, sign_of

VEHICLES = (26, 27, 28, 29, 30, 31, 32)


def extrinsic_rotation(amount: float, rng: np.random.Generator, about: About) -> Plan:
    axis = rng.normal(0, 1, 3)
    if rng.random() < 0.6:
        axis = np.eye(3)[rng.integers(3)] * sign_of(rng)
    roll, pitch, yaw = amount * axis / np.linalg.norm(axis)

    def rays(r: Rays, grid: Grid, moment: Moment) -> None:
        r.direction = r.direction @ _turn(roll, pitch, yaw).T

    return Plan({"roll_rad": float(roll), "pitch_rad": float(pitch), "yaw_rad": float(yaw)}, rays=[rays])


def extrinsic_translation(amount: float, rng: np.random.Generator, about: About) -> Plan:
    axis = rng.normal(0, 1, 3)
    if rng.random() < 0.6:
        axis = np.eye(3)[rng.integers(3)] * sign_of(rng)
    shift = amount * axis / np.linalg.norm(axis)

    def rays(r: Rays, grid: Grid, moment: Moment) -> None:
        r.offset = r.offset + shift

    return Plan(dict(zip(("x_m", "y_m", "z_m"), as_list(shift), strict=True)), rays=[rays])


def beam_elevation_error(amount: float, rng: np.random.Generator, about: About) -> Plan:
    error = centred(rng, about.rows, amount)

    def rays(r: Rays, grid: Grid, moment: Moment) -> None:
        d = r.direction
        flat = np.hypot(d[..., 0], d[..., 1])
        el = np.arctan2(d[..., 2], flat) + error[:, None]
        r.direction = np.concatenate([d[..., :2] / flat[..., None] * np.cos(el)[..., None], np.sin(el)[..., None]], -1)

    return Plan({"error_rad": as_list(error)}, rays=[rays])


def beam_azimuth_error(amount: float, rng: np.random.Generator, about: About) -> Plan:
    error = centred(rng, about.rows, amount)

    def rays(r: Rays, grid: Grid, moment: Moment) -> None:
        x, y, z = np.moveaxis(r.direction, -1, 0)
        cos, sin = np.cos(error)[:, None], np.sin(error)[:, None]
        r.direction = np.stack([cos * x - sin * y, sin * x + cos * y, z], -1)

    return Plan({"error_rad": as_list(error)}, rays=[rays])


def motion_distortion(amount: float, rng: np.random.Generator, about: About) -> Plan:
    def rays(r: Rays, grid: Grid, moment: Moment) -> None:
        columns = len(grid.azimuth)
        phase = (np.arange(columns) + 0.5) / columns - 0.5
        r.offset = r.offset + (amount * moment.speed_m_s * SCAN_S * phase)[None, :, None] * np.array([1.0, 0, 0])

    return Plan({"share": amount}, rays=[rays])


def incidence_cosine(amount: float, rng: np.random.Generator, about: About) -> Plan:
    """A goniometer's table: 19 angles with 1.5 % of reading error about a power of the cosine."""
    n = amount * (1 if rng.random() < 0.3 else -1)
    knots = np.deg2rad([0, 5, 10, 15, 20, 25, 30, 35, 40, 45, 50, 55, 60, 65, 70, 75, 80, 85, 89.3])
    law = table(knots, n * np.log(np.cos(knots)) + rng.normal(0, 0.015, 19) * min(1, abs(n) / 0.1))
    y = law(about.theta)
    x = np.log(np.cos(about.theta))
    found = fit(lambda t, e: e * t, [n], x, y, True)[0]
    return at("surface", lambda s: s.scale(np.exp(law(s.theta))), exponent=float(found))


def oren_nayar(amount: float, rng: np.random.Generator, about: About) -> Plan:
    law = laws.oren_nayar_facets(amount)
    y = np.log(np.maximum(law(about.theta), 1e-6))
    found = min(
        (fit(laws.oren_nayar_formula, [s], about.theta, y, True)[0] for s in (0.1, 0.3, 0.6)),
        key=lambda s: float(np.var(laws.oren_nayar_formula(about.theta, s) - y)),
    )
    return at("surface", lambda s: s.scale(law(s.theta)), roughness_rad=float(abs(found)))


def specular_lobe(amount: float, rng: np.random.Generator, about: About) -> Plan:
    """Microfacets (Beckmann slopes) on vehicles; what does not come back near normal is lost to the mirror."""
    slope = rng.uniform(0.15, 0.3)
    strength, loss = 4 * amount, min(0.95, amount)

    def lobe(theta: np.ndarray) -> np.ndarray:
        return np.exp(-((np.tan(np.minimum(theta, 1.5)) / slope) ** 2)) / np.cos(np.minimum(theta, 1.5)) ** 4

    x = np.linspace(0, 0.8, 200)
    scale, exponent = fit(lambda t, k, m: k * np.cos(t) ** m, [1.0, 2 / slope**2], x, lobe(x), False)

    def hook(s: State) -> None:
        on = np.isin(s.semantic, VEHICLES)
        s.scale(np.where(on, 1 + strength * lobe(s.theta), 1))
        s.lose(np.where(on, loss * (1 - np.cos(s.theta)), 0))

    return at(
        "surface", hook, strength=float(strength * scale), exponent=float(np.clip(exponent, 3, 200)), mirror_loss=loss
    )


def retroreflection(amount: float, rng: np.random.Generator, about: About) -> Plan:
    """Sheeting: gain over entrance angle, level to some 30 degrees, then falling (a data sheet's shape)."""
    wide = rng.uniform(0.6, 0.9)
    knots = np.deg2rad([0, 5, 15, 30, 40, 50, 60, 75, 90])
    law = table(knots, np.exp(-((knots / wide) ** 2)) * (1 + 0.03 * rng.normal(0, 1, 9)))
    x = np.linspace(0, 1.3, 200)
    gain, tolerance = fit(lambda t, g, w: g * np.exp(-((t / w) ** 2)), [amount, wide], x, amount * law(x), False)

    def hook(s: State) -> None:
        on = np.isin(s.semantic, (19, 20))
        s.scale(np.where(on, np.exp(amount * law(s.theta)) / np.cos(s.theta), 1))

    return at("surface", hook, gain=float(gain), tolerance_rad=float(abs(tolerance)))


def range_falloff(amount: float, rng: np.random.Generator, about: About) -> Plan:
    """Firmware's range table (14 knots, 1 % rounding) leaves part of the geometric spreading, or over-corrects."""
    p = amount * (1 if rng.random() < 0.75 else -1)
    knots = np.linspace(np.log(1.5), np.log(130), 14)
    law = table(knots, -p * (knots - np.log(10)) + rng.normal(0, 0.01, 14) * min(1, abs(p) / 0.1))
    x = np.log(about.range_m)
    found = fit(lambda t, e: -e * t, [p], x, law(x), True)[0]

    def hook(s: State) -> None:
        s.intensity = s.intensity * np.exp(law(np.log(np.where(s.hit, s.range_m, 10.0))))

    return at("path", hook, exponent=float(found))


def _by_range(law):
    return lambda s: s.scale(law(np.where(s.hit, s.range_m, 10.0)))


def atmospheric_extinction(amount: float, rng: np.random.Generator, about: About) -> Plan:
    law = laws.foggy_transmission(amount)
    y = np.log(law(about.range_m))
    found = fit(lambda r, a: -2 * a * r, [amount], about.range_m, y, True)[0]
    return at("path", _by_range(law), coefficient_per_m=float(found))


def near_range_overlap(amount: float, rng: np.random.Generator, about: About) -> Plan:
    law = laws.defocus(amount)

    def formula(r: np.ndarray, d: float) -> np.ndarray:
        return np.log(np.maximum(1 - np.exp(-((r / d) ** 2)), 1e-6))

    found = fit(formula, [amount], about.range_m, np.log(law(about.range_m)), True)[0]
    return at("path", _by_range(law), distance_m=float(abs(found)))


def window_contamination(amount: float, rng: np.random.Generator, about: About) -> Plan:
    """A film passed twice: one-way transmission 1 - a·bump; bounds of the patch lie inside the view."""
    loss, wide, drop = min(0.95, amount), rng.uniform(0.15, 0.5), rng.uniform(0.2, 0.6)
    low, high = about.edge_azimuth
    middle = rng.uniform(low + 0.2, high - 0.2)
    once = 1 - np.sqrt(1 - loss)
    x = np.linspace(-3 * wide, 3 * wide, 301)
    y = 2 * np.log(1 - once * laws.bump(x, wide))
    found, width = fit(
        lambda t, a, s: np.log(np.maximum(1 - a * np.exp(-0.5 * (t / s) ** 2), 1e-3)), [loss, wide], x, y, False
    )

    def hook(s: State) -> None:
        through = (1 - once * laws.bump(s.azimuth - middle, wide)) ** 2
        s.scale(through)
        s.lose(drop * (1 - through))

    return at("path", hook, loss=float(found), azimuth_rad=float(middle), width_rad=float(abs(width)), drop=float(drop))


def blooming(amount: float, rng: np.random.Generator, about: About) -> Plan:
    """Glare of bright targets: each of a target's pixels spills over its surroundings, strongest over its own range."""
    radius, p = rng.uniform(0.015, 0.04), min(0.95, amount)

    def hook(s: State) -> None:
        source = np.argwhere(s.hit & ((s.simulated["intensity"] >= 0.9) | np.isin(s.semantic, (20,))))
        if not len(source):
            return
        el, az = s.grid.elevation, s.grid.azimuth
        best, r, i = (np.zeros(s.hit.shape) for _ in range(3))
        for row, col in source:
            turn = np.angle(np.exp(1j * (az - az[col])))
            rows, cols = np.abs(el - el[row]) < 2.5 * radius, np.abs(turn) < 2.5 * radius
            block = np.ix_(rows, cols)
            d2 = (el[rows, None] - el[row]) ** 2 + (np.cos(el[row]) * turn[cols][None]) ** 2
            glare = np.exp(-d2 / radius**2)
            more = glare > best[block]
            for image, value in ((best, glare), (r, s.range_m[row, col]), (i, s.intensity[row, col] * 0.5)):
                image[block] = np.where(more, value, image[block])
        target = s.hit & np.isin(s.semantic, (20,))
        near = s.random("bloom").normal(0, 0.015, s.hit.shape)
        s.early.append((np.where(target, 0, p * best), r + near, i))
        s.outshine = True

    return at("path", hook, probability=p, radius_rad=float(radius))


def fog_backscatter(amount: float, rng: np.random.Generator, about: About) -> Plan:
    """Soft target: overlap rising over the first metres times extinction, speckled; the peak is taken as a return."""
    p, scale, level = min(0.9, amount), rng.uniform(1.0, 3.0), rng.uniform(0.02, 0.08)
    r = np.linspace(0.5, 120, 6000)
    density = (1 - np.exp(-((r / scale) ** 2))) * r * np.exp(-r / (0.85 * scale))
    cumulative = np.cumsum(density)
    x = np.interp(np.linspace(0.001, 0.999, 2000), cumulative / cumulative[-1], r)
    truth = max(0.5, float(x.mean() / 3))  # maximum likelihood of r² exp(-r/s)

    def hook(s: State) -> None:
        far = np.where(s.hit, s.range_m, 0.6)
        top = np.interp(far, r, cumulative)
        early = np.interp(s.random("fog").random(s.hit.shape) * top, cumulative, r)
        i = level * s.random("fog level").lognormal(-0.08, 0.4, s.hit.shape)
        s.early.append((np.where(s.hit, p, 0.0), early, i))

    return at("path", hook, probability=p, scale_m=truth, intensity=float(level))


def precipitation_clutter(amount: float, rng: np.random.Generator, about: About) -> Plan:
    """Poisson scatterers in the beam's cone; a drop is seen with a chance that falls with its range; nearest wins."""
    scale, level = rng.uniform(8, 40), rng.uniform(0.02, 0.1)
    r = np.linspace(1.5, 120, 6000)
    rate = np.exp(-r / scale) / r**2
    depth = np.cumsum(rate)
    share = np.interp(about.range_m, r, depth / depth[-1])
    p = min(0.9, amount)
    expected = p / max(share.mean(), 0.05)

    def hook(s: State) -> None:
        seen = s.random("drops").exponential(1, s.hit.shape) * depth[-1] / expected
        within = np.interp(np.where(s.hit, s.range_m, 1.5), r, depth)
        early = np.interp(seen, depth, r)
        i = level * s.random("drop level").lognormal(-0.18, 0.6, s.hit.shape)
        s.early.append((np.where(s.hit & (seen < within), 1.0, 0.0), early, i))

    p_true = float(np.mean(1 - np.exp(-expected * share)))
    return at("path", hook, probability=p_true, scale_m=float(scale), intensity=float(level))


def interference(amount: float, rng: np.random.Generator, about: About) -> Plan:
    """Foreign pulses come at any time, so at any range before the surface; also where nothing is hit."""
    p, level = min(0.5, amount), rng.uniform(0.05, 0.4)

    def hook(s: State) -> None:
        far = np.where(s.hit, s.range_m, 100.0)
        early = 0.5 + s.random("foreign").random(s.hit.shape) * np.maximum(far - 0.5, 0)
        i = level * s.random("foreign level").lognormal(-0.08, 0.4, s.hit.shape)
        s.early.append((np.full(s.hit.shape, p), early, i))

    return at("path", hook, probability=p, intensity=float(level))


DEGREE = np.pi / 180
LIGHT = {
    "extrinsic_rotation": Effect(extrinsic_rotation, ("range", "intensity", "drop"), "rad of turn", 0.1 * DEGREE),
    "extrinsic_translation": Effect(extrinsic_translation, ("range", "intensity", "drop"), "m of shift", 0.02, 0.5),
    "beam_elevation_error": Effect(
        beam_elevation_error, ("range", "intensity", "drop"), "rad sd over beams", 0.02 * DEGREE, 0.004
    ),
    "beam_azimuth_error": Effect(
        beam_azimuth_error, ("range", "intensity", "drop"), "rad sd over beams", 0.02 * DEGREE, 0.004
    ),
    "motion_distortion": Effect(motion_distortion, ("range", "intensity", "drop"), "share of ego motion", 0.25, 1.5),
    "incidence_cosine": Effect(incidence_cosine, ("intensity",), "exponent", 0.09, 1.0),
    "oren_nayar": Effect(oren_nayar, ("intensity",), "rad of roughness", 0.12, 1.1),
    "specular_lobe": Effect(specular_lobe, ("intensity", "drop"), "mirror loss; strength is 4 times", 0.1, 0.9),
    "retroreflection": Effect(retroreflection, ("intensity",), "nats at normal incidence", 0.3, 5.0),
    "range_falloff": Effect(range_falloff, ("intensity",), "exponent", 0.09, 2.0),
    "atmospheric_extinction": Effect(atmospheric_extinction, ("intensity",), "1/m", 0.001, 0.05),
    "near_range_overlap": Effect(near_range_overlap, ("intensity",), "m", 2.0, 12.0),
    "window_contamination": Effect(window_contamination, ("intensity", "drop"), "loss in the middle", 0.09, 0.9),
    "blooming": Effect(blooming, ("range", "intensity", "drop"), "probability", 0.1, 0.95),
    "fog_backscatter": Effect(fog_backscatter, ("range", "intensity", "drop"), "probability", 0.01, 0.8),
    "precipitation_clutter": Effect(precipitation_clutter, ("range", "intensity", "drop"), "probability", 0.01, 0.8),
    "interference": Effect(interference, ("range", "intensity", "drop"), "probability", 0.005, 0.5),
}
