"""`jaxsim effects`: the catalogue of what an ideal ray model leaves out, and effects of one's own (`new`, `check`)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from jaxsim.cli.flags import EffectFiles
from jaxsim.effects import all_rays, get_effect
from jaxsim.effects.own import known_effects, load_file, write_template
from jaxsim.effects.page import describe, effects_table
from jaxsim.effects.street import small_street
from jaxsim.files import as_argument


@dataclass(frozen=True)
class Effects:
    """Lists the effects, or prints one with its formula, parameters, signs, look-alikes and source.

    `jaxsim effects new NAME` writes a file of an effect of your own to begin with, `jaxsim effects check FILE.py` tells
    what is wrong with it. Effects of installed packages (entry points of the group jaxsim.effects) are listed too.
    """

    name: Annotated[str, tyro.conf.Positional] = ""
    """An effect; all where it is not given."""
    effects_from: EffectFiles = ()

    def __call__(self) -> None:
        known_effects(self.effects_from)
        print(describe(get_effect(self.name)) if self.name else effects_table())


@dataclass(frozen=True)
class NewEffect:
    """Writes a Python file with an effect to begin with: a commented example that works, to be made your own, or the
    formula that `jaxsim discover` found for what no effect describes.

    Then `jaxsim effects check FILE.py`, and `jaxsim discover ... --effects-from FILE.py`.
    """

    name: Annotated[str, tyro.conf.Positional]
    """Name of the effect, lower-case words like rain_on_lens."""
    out: Path | None = None
    """File to write; by default NAME.py here."""
    from_: Annotated[Path | None, tyro.conf.arg(name="from")] = None
    """A verdict.json of `jaxsim discover` whose `law` is to become the effect."""

    def __call__(self) -> None:
        path = self.out or Path(f"{self.name}.py")
        if self.from_:
            from jaxsim.discover.law.source import read_law, write_effect  # much, which the list need not wait for

            write_effect(read_law(self.from_), path, name=self.name)
        else:
            write_template(self.name, path)
        print(f"{path}: edit it, then jaxsim effects check {as_argument(path)}")


@dataclass(frozen=True)
class CheckEffect:
    """Runs a Python file, checks its effect, and prints its formula, parameters and look-alikes.

    Checked are its fields, and its `apply` on rays of a small street: nothing at neutral, shapes kept, no NaN, finite
    derivatives, no channel changed but its own. Look-alikes are the effects of the catalogue that, fitted to its
    expectation on that street, reproduce most of it; `jaxsim discover` computes them on the frames at hand.
    """

    file: Annotated[Path, tyro.conf.Positional]
    """A Python file that ends in EFFECT. Its code is run: give only files that you have read."""

    def __call__(self) -> None:
        from jaxsim.discover.name.look_alikes import described  # as above

        known_effects()
        scan = small_street()
        print(describe(described(load_file(self.file), all_rays(scan), scan)))
        print(f"\n{self.file}: all checks passed; jaxsim discover ... --effects-from {as_argument(self.file)}")
