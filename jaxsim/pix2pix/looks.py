"""How a network that gives a distribution looks at a window: several ways, whose answers' mean counts."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float


class Look(NamedTuple):
    """A window as a network may see it: in a mirror or not, and with rows added that repeat those beside them in
    reverse."""

    mirrored: bool
    above: int = 0
    below: int = 0

    def at(self, inputs: Float[Array, "b h w c"]) -> Float[Array, "b h_more w c"]:
        """The inputs as they are seen."""
        seen = inputs[:, :, ::-1] if self.mirrored else inputs
        return jnp.pad(seen, ((0, 0), (self.above, self.below), (0, 0), (0, 0)), mode="reflect")

    def back(self, outputs: Float[Array, "b h_more w k"], rows: int) -> Float[Array, "b rows w k"]:
        """What was answered so, each cell where it is without."""
        outputs = outputs[:, self.above : self.above + rows]
        return outputs[:, :, ::-1] if self.mirrored else outputs


LOOKS = (Look(False), Look(True), Look(False, above=6, below=10), Look(True, above=11, below=5))
"""The first so many of them are taken. Mirrored, the window is of another street of the same sensor; lifted, its rows
are told by what they show and not by their place. Errors of the answers partly cancel. With 16 more rows in all a
network's halvings fill up no more than without; rows that they put together come apart, lifted by 11 at once, by 6 one
halving deeper."""
