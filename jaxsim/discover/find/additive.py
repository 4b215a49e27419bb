"""An additive model of residuals: curves along covariates, fitted by ridge regression, judged on held-out scenes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float, Int

from jaxsim.discover.rules import RULES


class Additive:
    """Residuals `z` and the columns of each covariate's curve; `scene` is each residual's scene, of `scenes`.

    Products of columns are summed once by fold, so that any choice of curves costs one small system a fold.
    """

    def __init__(
        self,
        z: Float[np.ndarray, " n"],
        designs: Mapping[str, Float[np.ndarray, "n _"]],
        scene: Int[np.ndarray, " n"],
        *,
        scenes: int,
    ):
        self.z = z
        self.scene = scene
        self.scenes = scenes
        self.x = np.concatenate([np.ones((len(z), 1), np.float32), *designs.values()], axis=1)
        ends = np.cumsum([1, *(design.shape[1] for design in designs.values())])
        self.columns = {name: np.arange(*ends[k : k + 2]) for k, name in enumerate(designs)}
        folds = min(RULES.additive_folds, scenes)
        self.parts = [np.flatnonzero(scene % folds == k) for k in range(folds)]
        # Products in single precision are summed in double: the systems that are solved hold all folds but one.
        self.squares = [(self.x[part].T @ self.x[part]).astype(np.float64) for part in self.parts]
        self.products = [self.x[part].T @ z[part].astype(np.float64) for part in self.parts]

    def predicted(self, names: Sequence[str]) -> Float[np.ndarray, " n"]:
        """What a constant and the named curves say of each residual, fitted to the scenes of the other folds."""
        used = np.concatenate([[0], *(self.columns[name] for name in names)]).astype(int)
        prediction = np.zeros(len(self.z))
        for part, square, product in zip(self.parts, self.squares, self.products, strict=True):
            gram = (sum(self.squares) - square)[np.ix_(used, used)] + RULES.ridge * np.eye(len(used))
            prediction[part] = self.x[np.ix_(part, used)] @ np.linalg.solve(gram, (sum(self.products) - product)[used])
        return prediction

    def by_scene(
        self, before: Float[np.ndarray, " n"], after: Float[np.ndarray, " n"]
    ) -> tuple[Float[np.ndarray, " s"], Float[np.ndarray, " s"]]:
        """Held-out gain of each scene from one prediction to another, nats, and its rate at the start of the way.

        The rate is what a scene says of the direction: below 0 as often as above where there is nothing to find. The
        gain is then mostly below, for it pays for what was fitted to chance.
        """
        residual = self.z - before
        change = after - before
        rate = np.bincount(self.scene, residual * change, self.scenes)
        return rate - 0.5 * np.bincount(self.scene, change**2, self.scenes), rate
