"""`jaxsim effects`: the catalogue of what an ideal ray model leaves out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import tyro

from jaxsim.effects import get_effect
from jaxsim.effects.page import describe, table


@dataclass(frozen=True)
class Effects:
    """Lists the effects, or prints one with its formula, parameters, signs, look-alikes and source."""

    name: Annotated[str, tyro.conf.Positional] = ""
    """An effect; all where it is not given."""

    def __call__(self) -> None:
        print(describe(get_effect(self.name)) if self.name else table())
