"""The catalogue in words: `jaxsim effects` and docs/effects.md (`python -m jaxsim.effects.page > docs/effects.md`)."""

from __future__ import annotations

import math

from jaxsim.effects import EFFECTS, STAGES, Effect, Parameter
from jaxsim.effects.origin import OwnEffect

INTRO = """# Catalogue of effects

What light, optics, electronics and mounting do to an ideal ray's range and intensity: the names that
`jaxsim discover` gives, and the entries of `sensor.json` that `jaxsim simulate --effects` applies. This page is
made by `python -m jaxsim.effects.page > docs/effects.md` from the code; `jaxsim effects NAME` prints one entry.

r range (m), θ incidence angle, I reported intensity (0..1), P received power (ln P = ln I − 2 ln(r / 10 m) before
any effect), az azimuth, u place within the scan (0 first fired, 1 last), keep the probability that the surface's
echo is reported. Within an effect cosines are at least 0.02, tangents at most 50, noise of ranges at most 50 times
its standard deviation, and an intensity below 0.0001 counts as that and is reported as 0. A ray has one law of
false returns before its surface, that of the likeliest effect. Effects act in the order of this page. An effect is
one file of `jaxsim/effects/catalogue/`: its parameters, one differentiable function on `Rays`, its text on this
page. CONTRIBUTING.md shows how to add one.

A sensor model is a `sensor.json`:

```
{"effects": [{"name": "beam_gain", "parameters": {"gain": [0.03, -0.11, ...]}},    one number a beam, or one for all
             {"name": "snr_dropout", "parameters": {"threshold": -6.5}}]}          what is not given is neutral
```
"""
STAGE_WORDS = {
    "geometry": "where rays truly go; they are cast again on the simulated surfaces",
    "surface": "what a surface returns",
    "path": "what happens on the way",
    "receiver": "what the receiver and the firmware make of it",
    "detection": "whether an echo is reported",
    "ranging": "what range is reported",
}


def effects_table() -> str:
    """The list of effects, a line each: name, stage, channels, title."""
    rows = [("name", "stage", "channels", "")]
    rows += [(e.name, e.stage, ", ".join(e.channels), e.title) for e in EFFECTS.values()]
    widths = [max(len(row[k]) for row in rows) for k in range(3)]
    return "\n".join("  ".join([*(row[k].ljust(widths[k]) for k in range(3)), row[3]]).rstrip() for row in rows)


def describe(effect: Effect) -> str:
    """All that the catalogue says of an effect, as plain text."""
    lines = [f"{effect.name}: {effect.title}", f"stage {effect.stage}, changes {', '.join(effect.channels)}", ""]
    lines += [f"  {effect.formula}", "", "parameters"]
    width = max(map(len, effect.parameters))
    lines += [f"  {name.ljust(width)}  {parameter_in_words(p)}" for name, p in effect.parameters.items()]
    text = [f"  {effect.signature}"] if effect.signature else []
    lines += ["", "signature", *text, f"  covariates: {', '.join(effect.covariates) or 'none'}"]
    alike = effect.alike if isinstance(effect, OwnEffect) else ()
    shares = {one.name: f" ({100 * one.share:.0f} % of it)" for one in alike}
    lines += ["", "look-alikes, and what tells them apart"]
    lines += [f"  {other}{shares.get(other, '')}: {how}" for other, how in effect.look_alikes.items()]
    sources = [effect.source, str(effect.origin) if isinstance(effect, OwnEffect) else ""]
    return "\n".join([*lines, "", f"source: {'; '.join(filter(None, sources))}"])


def parameter_in_words(p: Parameter) -> str:
    """Meaning, shape, bounds and neutral value of a parameter."""
    many = {"scalar": "", "row": " (one a beam)", "class": " (one a class)"}[p.shape]
    unit = f" {p.unit}" if p.unit else ""
    fixed = "" if p.to_fit else "; given, not fitted"
    bounds = f"{few_digits(p.low)}..{few_digits(p.high)}{unit}"
    usual = f"starts from {few_digits(p.neutral)}; typical {few_digits(p.scale)}"
    return f"{p.meaning}{many}: {bounds}; {usual}{fixed}"


def few_digits(value: float) -> str:
    """A number in few digits, with pi by name."""
    return {math.pi: "π", -math.pi: "−π"}.get(value, f"{value:g}")


def page() -> str:
    """The whole of docs/effects.md."""
    parts = [INTRO]
    for stage in STAGES:
        parts.append(f"\n## {stage.capitalize()}: {STAGE_WORDS[stage]}\n")
        parts += [_entry(effect) for effect in EFFECTS.values() if effect.stage == stage]
    return "".join(parts)


def _entry(effect: Effect) -> str:
    """An effect's part of the page."""
    parameters = "\n".join(f"- `{name}`: {parameter_in_words(p)}" for name, p in effect.parameters.items())
    others = "\n".join(f"- `{other}`: {how}." for other, how in effect.look_alikes.items())
    return f"""
### {effect.name}

{effect.title[0].upper()}{effect.title[1:]}. Changes {", ".join(effect.channels)}.

```
{effect.formula}
```

{parameters}

{effect.signature}

Look-alikes:

{others}

Source: {effect.source}.
"""


if __name__ == "__main__":
    print(page(), end="")
