"""`jaxsim engines`: what `jaxsim discover` found, in another simulator's parameters."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from jaxsim.config.ranges import Checked
from jaxsim.effects.own import known_effects
from jaxsim.engines import ENGINES, Setting, Translation, check_page, read_answer, translate
from jaxsim.files import check_apart, placed, read_json, real, write_text
from jaxsim.report.results import markdown_table


@dataclass(frozen=True)
class Engines(Checked):
    """Writes a sensor.json as the parameters that an engine has, with intervals, and says what it cannot express.

        jaxsim engines answer/sensor.json --for carla --out carla.json

    Intervals come from the verdict.json beside the sensor.json. With --out the parameters are written in the engine's
    own format, and beside them NAME.md with all that was said.
    """

    answer: Annotated[Path, tyro.conf.Positional]
    """sensor.json of an answer."""
    engine: Annotated[
        Literal["carla", "isaac", "rgl", "gazebo", "helios"], tyro.conf.arg(name="for", aliases=["--engine"])
    ] = "carla"
    """The simulator."""
    now: Path | None = None
    """JSON of parameters that CARLA has now, `{"atmosphere_attenuation_rate": 0.004}`: the answer is what it lacks
    beside these."""
    out: Path | None = None
    """File to write, in the engine's own format."""

    def __call__(self) -> None:
        if self.out and self.out.suffix == ".md":
            wanted = self.out.with_suffix(ENGINES[self.engine].suffix)
            raise ValueError(f"engines: --out {self.out} is where the words go, beside the parameters; give {wanted}")
        for written in (self.out, self.out.with_suffix(".md")) if self.out else ():
            check_apart(written, self.answer, self.answer.with_name("verdict.json"), self.now, by="engines")
        if self.out:
            check_page(self.out.with_suffix(".md"))
        known_effects()
        now = _numbers(self.now) if self.now else {}
        translation = translate(read_answer(self.answer), self.engine, ENGINES[self.engine], now=now)
        page = words(translation)
        print(page)
        if self.out:
            write_text(self.out, translation.text)
            write_text(self.out.with_suffix(".md"), page)
        else:
            print(translation.text)


def _numbers(path: Path) -> dict[str, float]:
    content = read_json(path, by="engines")
    wrong = f'engines: {path} must be an object of numbers, {{"noise_stddev": 0.0}}'
    with placed(wrong, AttributeError, TypeError):
        return {key: real(value) for key, value in content.items()}


def words(translation: Translation) -> str:
    """A translation as Markdown: a table of parameters, and what cannot be expressed."""
    engine = ENGINES[translation.engine]
    lines = [f"# {engine.title}", ""]
    if translation.settings:
        rows = [(f"`{s.name}`", _value(s), _ends(s), s.unit, s.why) for s in translation.settings]
        lines.append(markdown_table(("parameter", "value", "90 % interval", "unit", "of"), rows))
    else:
        lines.append(f"Nothing that {engine.title} has a parameter for.")
    if translation.cannot:
        lines += ["", f"What {engine.title} cannot express, and what does it instead:", ""]
        lines += [f"- `{what}`: {why}" for what, why in translation.cannot.items()]
    lines += ["", *(f"{note}\n" for note in translation.notes), "Facts from " + ", ".join(engine.links), ""]
    return "\n".join(lines)


def _value(one: Setting) -> str:
    """The number; of one a beam the span, since their mean says of none what it is."""
    if not one.each:
        return f"{one.value.value:.4g}"
    values = [beam.value for beam in one.each]
    return f"{min(values):.4g} to {max(values):.4g}, of {len(values)} beams"


def _ends(one: Setting) -> str:
    if math.isnan(one.value.low):
        return "not given"
    return "of each in verdict.json" if one.each else f"{one.value.low:.4g} .. {one.value.high:.4g}"
