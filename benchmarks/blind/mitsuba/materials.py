"""What surfaces do with light: a BSDF of Mitsuba each, and the Lambert surface that a simulator has for it."""

from __future__ import annotations

from typing import Any, NamedTuple

import mitsuba as mi
import numpy as np

mi.set_variant("scalar_rgb")

CONTEXT = mi.BSDFContext()
COAT_F0 = 0.01
"""Reflectance of a car's worn coat, head on."""
TEXELS = 128


class Material(NamedTuple):
    """Two BSDFs of one surface; `true` is what it does, `plain` is Lambert's law with its albedo."""

    true: Any
    plain: Any


def noise_texture(rng: np.random.Generator, level: float, contrast: float, repeats: tuple[float, float]) -> dict:
    """A bitmap of grains and blotches: lognormal about `level`, `contrast` nats; `repeats` of it over the surface."""
    logs = np.zeros((TEXELS, TEXELS))
    for width in (1.0, 5.0, 16.0):
        wave = np.fft.fftfreq(TEXELS)[:, None] ** 2 + np.fft.fftfreq(TEXELS)[None] ** 2
        blurred = np.fft.ifft2(np.fft.fft2(rng.normal(size=logs.shape)) * np.exp(-2 * (np.pi * width) ** 2 * wave)).real
        logs += blurred / blurred.std()
    image = np.clip(level * np.exp(contrast * logs / np.sqrt(3)), 0.005, 0.98)
    bitmap = mi.Bitmap(image[..., None].astype(np.float32))
    return {"type": "bitmap", "bitmap": bitmap, "raw": True, "wrap_mode": "repeat", "to_uv": _scaled(repeats)}


def check_texture(low: float, high: float, repeats: tuple[float, float]) -> dict:
    """Tiles or bricks of two reflectances; a tile is half a repeat wide."""
    return {"type": "checkerboard", "color0": even(low), "color1": even(high), "to_uv": _scaled(repeats)}


def even(level: float) -> dict:
    """One reflectance all over."""
    return {"type": "rgb", "value": [float(np.clip(level, 0.0, 0.98))] * 3}


def matte(texture: dict, roughness: float) -> Material:
    """Stone, asphalt, plaster: Burley's rough diffuse law with a weak coat (Mitsuba's `principled`)."""
    true = {"type": "principled", "base_color": texture, "roughness": roughness, "specular": 0.25}
    return Material(_both_sides(true), _lambert(texture))


def lambert(texture: dict) -> Material:
    return Material(_lambert(texture), _lambert(texture))


def cloth(texture: dict) -> Material:
    true = {"type": "principled", "base_color": texture, "roughness": 0.9, "specular": 0.1, "sheen": 0.8}
    return Material(_both_sides(true), _lambert(texture))


def plastic(texture: dict, alpha: float) -> Material:
    """Road paint and dark panes: a diffuse base below a rough dielectric coat.

    Mitsuba tabulates such a coat when it is made, which takes it some tenth of a second.
    """
    true = {"type": "roughplastic", "diffuse_reflectance": texture, "alpha": alpha, "distribution": "ggx"}
    return Material(_both_sides(true), _lambert(texture))


def metal(alpha: float) -> Material:
    """Rough steel; of metal, that has no albedo, a simulator's table says 0.4."""
    true = {"type": "roughconductor", "material": "Cr", "alpha": alpha, "distribution": "ggx"}
    return Material(_both_sides(true), _lambert(even(0.4)))


def lacquer(albedo: float, strength: float, alpha: float) -> Material:
    """Cars, signs, lamps: head on, a lobe `strength` times as bright as the base. The plain twin is the base alone.

    A coat with flakes of metal in it (Mitsuba's `principled`). Head on, a GGX lobe of a reflectance F returns
    F / 4 alpha² (times pi): of the coat F0, of flakes the albedo, and flakes take their share m from the base, so that
    strength = (F0 / albedo + m / (1 - m)) / 4 alpha².
    """
    flakes = max(4 * alpha**2 * strength - COAT_F0 / albedo, 0.0)
    share = flakes / (1 + flakes)
    true = {
        "type": "principled",
        "base_color": even(albedo),
        "roughness": float(np.sqrt(alpha)),
        "specular": COAT_F0 / 0.08,
        "metallic": share,
    }
    return Material(_both_sides(true), _lambert(even((1 - share) * albedo)))


def head_on(bsdf: Any) -> float:
    """pi times the BRDF at normal incidence: the albedo of the Lambert surface that is as bright."""
    si = mi.SurfaceInteraction3f()
    si.wi = mi.Vector3f(0, 0, 1)
    return float(np.pi * bsdf.eval(CONTEXT, si, si.wi)[0])


def _lambert(texture: dict) -> Any:
    return _both_sides({"type": "diffuse", "reflectance": texture})


def _both_sides(bsdf: dict) -> Any:
    return mi.load_dict({"type": "twosided", "bsdf": bsdf})


def _scaled(repeats: tuple[float, float]) -> Any:
    return mi.ScalarTransform4f().scale([float(repeats[0]), float(repeats[1]), 1.0])
