"""Effects of one's own beside the catalogue: those of installed packages, and those of files that the user names.

A package registers an effect by an entry point, in its pyproject.toml:

    [project.entry-points."jaxsim.effects"]
    rain_on_lens = "acme_lidar.rain:EFFECT"

A file ends in `EFFECT`, as the catalogue's do. It is code and is run: only a path that the user typed is ever loaded.
"""

from __future__ import annotations

import hashlib
import sys
import traceback
from collections.abc import Iterator, Sequence
from dataclasses import fields
from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType
from typing import Any

from jaxsim.effects.catalogue import EFFECTS
from jaxsim.effects.check import check_effect, may_be_called
from jaxsim.effects.effect import STAGES, Effect
from jaxsim.effects.origin import Origin, OwnEffect
from jaxsim.files import loaded, placed, write_text

GROUP = "jaxsim.effects"
"""Group of entry points."""


def known_effects(files: Sequence[Path | str] = ()) -> dict[str, Effect]:
    """The catalogue, the effects of installed packages, and those of these Python files (which are run), by name in
    physical order: an own effect acts last in its stage. They stay known to this process.

    Raises ValueError for files and entry points that hold no effect, or one that `check_effect` refuses, and for names
    that are taken.
    """
    taken: dict[str, Origin] = {}
    for effect in (*_of_packages(), *(load_file(Path(file)) for file in dict.fromkeys(files))):
        if effect.name in taken:
            raise ValueError(
                f"effects: two effects are named {effect.name}: from {taken[effect.name]}, and from {effect.origin}; "
                "rename one, or leave it out"
            )
        taken[effect.name] = effect.origin
        register_effect(effect)
    return dict(EFFECTS)


def register_effect(effect: OwnEffect) -> None:
    """Makes an effect known, at the end of its stage; one of the same name and from elsewhere gives way."""
    others = {name: one for name, one in EFFECTS.items() if name != effect.name}
    # EFFECTS is in physical order, which chains follow.
    later = STAGES[STAGES.index(effect.stage) + 1 :]
    before = {name: one for name, one in others.items() if one.stage not in later}
    # The very dict that other modules imported.
    EFFECTS.clear()
    EFFECTS.update({**before, effect.name: effect, **others})


def _of_packages() -> Iterator[OwnEffect]:
    for point in sorted(entry_points(group=GROUP), key=lambda point: point.name):
        package = point.dist.name if point.dist else point.value
        origin = Origin(package=package, version=point.dist.version if point.dist else "of no distribution")
        where = f"entry point {point.name} of {origin}"
        yield own_effect(loaded(point, by="effects", what=where), origin, where)


def load_file(path: Path) -> OwnEffect:
    """Runs a Python file and takes its EFFECT."""
    if path.suffix != ".py" or not path.is_file():
        kind = "no file" if path.suffix == ".py" else "no Python file"
        raise ValueError(
            f"effects: {kind} {path}; --effects-from takes a FILE.py that ends in EFFECT (`jaxsim effects new NAME` "
            "writes one)"
        )
    # What is run is what was hashed.
    code = path.read_bytes()
    module = ModuleType(f"jaxsim_own_{path.stem}")
    module.__file__ = str(path)
    # Dataclasses and pickles look their module up by name.
    sys.modules[module.__name__] = module
    try:
        exec(compile(code, str(path), "exec"), module.__dict__)
    except (Exception, SystemExit) as error:
        more = "; `jaxsim effects new NAME` writes a file with every field" if isinstance(error, TypeError) else ""
        raise ValueError(f"effects: {_line_of(path, error)}: {type(error).__name__}: {error}{more}") from error
    if "EFFECT" not in vars(module):
        raise ValueError(
            f"effects: {path} has no EFFECT; end it with EFFECT = Effect(...), as `jaxsim effects new` does"
        )
    return own_effect(module.EFFECT, Origin(file=path.name, sha256=hashlib.sha256(code).hexdigest()), str(path))


def own_effect(effect: Any, origin: Origin, where: str) -> OwnEffect:
    """An effect with where it comes from, checked. Raises ValueError, worded with `where`, for what is none."""
    if not isinstance(effect, Effect):
        raise ValueError(f"effects: {where} gives {type(effect).__name__}; it must be a jaxsim.effects.Effect")
    own = OwnEffect(**{field.name: getattr(effect, field.name) for field in fields(Effect)}, origin=origin)
    if EFFECTS.get(own.name) == own:
        return own
    with placed(f"effects: {where}"):
        check_effect(own)
    return own


def _line_of(path: Path, error: BaseException) -> str:
    """The file, and the line of it that an error came from."""
    lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == str(path)]
    line = lines[-1] if lines else getattr(error, "lineno", None)
    return f"{path}, line {line}" if line else str(path)


TEMPLATE = '''"""An effect of one's own: `jaxsim effects check {name}.py` tells what is wrong with it.

It begins as an example: optics pass less light at an angle to their axis.
"""

import jax.numpy as jnp

from jaxsim.effects import Effect, Parameter
from jaxsim.effects.edits import brighten  # others: lose, misread, add_intensity, displace


def apply(p, rays):
    # p: the parameters as arrays. rays: what each ray meets and what becomes of it, by the names of
    # jaxsim.effects.rays.Rays. Give rays back; use jax.numpy; at neutral parameters change nothing.
    return brighten(rays, 4 * p["share"] * jnp.log(jnp.cos(rays.elevation_rad)))


EFFECT = Effect(
    name="{name}",
    stage="receiver",  # when it acts: geometry, surface, path, receiver, detection, ranging
    title="beams far from the optical axis are dimmer",
    formula="ln I, ln P += share · 4 ln cos(elevation)",
    # neutral (does nothing), least, most, unit, meaning, and a distance from neutral that is clearly visible;
    # shape="row" is a number a beam, shape="class" one a class.
    parameters={{"share": Parameter(0.0, 0.0, 1.0, "", "share of the natural fall-off that is left", scale=0.3)}},
    channels=("intensity",),  # what apply changes: intensity, range, drop
    covariates=("row",),  # what it betrays itself by: range, incidence, row, azimuth, class, power ...
    apply=apply,
)
'''


def write_template(name: str, path: Path) -> Path:
    """Writes a commented file of an effect to begin with. Raises ValueError for a name that cannot be one or is taken,
    and where the file is there."""
    if not may_be_called(name) or name in EFFECTS:
        why = "taken" if name in EFFECTS else "no name of an effect"
        raise ValueError(f"effects: {name!r} is {why}; give lower-case words like rain_on_lens")
    if path.exists():
        raise ValueError(f"effects: {path} is there already; give another --out, or remove it")
    return write_text(path, TEMPLATE.format(name=name))
