"""`jaxsim effects`: the catalogue of what an ideal ray model leaves out, and effects of one's own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import tyro

from jaxsim.cli.flags import EffectFiles
from jaxsim.effects import get_effect
from jaxsim.effects.own import known_effects
from jaxsim.effects.page import describe, effects_table


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
