"""An additive model of residuals: curves along covariates, fitted by ridge regression, judged on held-out units."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float, Int

RIDGE = 4.0
"""Observations' worth of pull of a curve's knots to 0."""
FOLDS = 4


class Additive:
    """Residuals `z` and the columns of each covariate's curve; `place` is each residual's unit, of `units`.

    Products of columns are summed once by fold, so that any choice of curves costs one small system a fold.
    """

    def __init__(
        self,
        z: Float[np.ndarray, " n"],
        designs: Mapping[str, Float[np.ndarray, "n _"]],
        place: Int[np.ndarray, " n"],
        units: int,
    ):
        self.z, self.place, self.units = z, place, units
        self.x = np.concatenate([np.ones((len(z), 1), np.float32), *designs.values()], axis=1)
        ends = np.cumsum([1, *(design.shape[1] for design in designs.values())])
        self.columns = {name: np.arange(*ends[k : k + 2]) for k, name in enumerate(designs)}
        folds = min(FOLDS, units)
        self.parts = [np.flatnonzero(place % folds == k) for k in range(folds)]
        self.squares = [(self.x[part].T @ self.x[part]).astype(np.float64) for part in self.parts]
        self.products = [self.x[part].T @ z[part].astype(np.float64) for part in self.parts]

    def predicted(self, names: Sequence[str]) -> Float[np.ndarray, " n"]:
        """What a constant and the named curves say of each residual, fitted to the units of the other folds."""
        used = np.concatenate([[0], *(self.columns[name] for name in names)]).astype(int)
        found = np.zeros(len(self.z))
        for part, square, product in zip(self.parts, self.squares, self.products, strict=True):
            gram = (sum(self.squares) - square)[np.ix_(used, used)] + RIDGE * np.eye(len(used))
            found[part] = self.x[np.ix_(part, used)] @ np.linalg.solve(gram, (sum(self.products) - product)[used])
        return found

    def by_unit(
        self, before: Float[np.ndarray, " n"], after: Float[np.ndarray, " n"]
    ) -> tuple[Float[np.ndarray, " u"], Float[np.ndarray, " u"]]:
        """Held-out gain of each unit from one prediction to another, nats, and its rate at the start of the way.

        The rate is what a unit says of the direction: below 0 as often as above where there is nothing to find. The
        gain is then mostly below, for it pays for what was fitted to chance.
        """
        left, more = self.z - before, after - before
        rate = np.bincount(self.place, left * more, self.units)
        return rate - 0.5 * np.bincount(self.place, more**2, self.units), rate
