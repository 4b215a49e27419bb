"""Find: which channel's residuals depend on which covariate, given the others.

Residuals are brought to a standard normal scale by the null model (intensity and range by their own
distribution, drop by its rate), so that one tool serves the three channels: an additive model of smooth curves,
one a covariate, fitted by ridge regression and judged on held-out scenes.

An effect may depend on two covariates and show along neither. So what the additive model of all covariates leaves is
held against products of two covariates' curves (`interactions`). The strongest must beat what the strongest of all
gains by chance (`scenes.best_of_gains`), so that trying many is paid for.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxsim.devices import side_by_side
from jaxsim.discover.find.covariates import COVARIATES, Dependence, curve_basis, products, spelled, values_of
from jaxsim.discover.find.division import NOTHING_YET, Division, NullModel
from jaxsim.discover.model.fit import Problem
from jaxsim.discover.model.null_model import standardised
from jaxsim.discover.rules import RULES
from jaxsim.discover.scenes import ROUNDING, best_of_gains, folds, rank_correlation, signs_of
from jaxsim.discover.verdict import Where
from jaxsim.effects.chain import SensorModel

NUISANCES = (("intensity", "class"),)
"""Dependences that are never listed, for they are a nuisance: what is left along it says how far reflectances are held
to the table."""
READ_OFF = (("range", "height"),)
"""Dependences that are not tried: a height is read off the simulated range, and on level ground differs by nothing but
the errors of that."""
CROSSED = ("range", "incidence", "row", "azimuth", "class", "power", "intensity", "step side", "time", "speed")
"""Covariates whose interactions are tried; time since the first frame has too few values to be crossed with others."""


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
        x = np.concatenate([np.ones((len(z), 1), np.float32), *designs.values()], axis=1)
        ends = np.cumsum([1, *(design.shape[1] for design in designs.values())])
        self.columns = {name: slice(*ends[k : k + 2]) for k, name in enumerate(designs)}
        # Whole scenes are held out: rays of one street would tell each other's residuals.
        self.parts = [np.flatnonzero(fitted == 0) for fitted in folds(scene, RULES.additive_folds)]
        # Products in single precision are summed in double: the systems that are solved hold all folds but one.
        held_out = [x[part] for part in self.parts]
        squares = [(design.T @ design).astype(np.float64) for design in held_out]
        # Of all folds but one: no curve is fitted again from its rays.
        self.squares = [sum(squares) - own for own in squares]
        self.held_out = [design.astype(np.float64) for design in held_out]
        self.products = [design.T @ z[part] for design, part in zip(self.held_out, self.parts, strict=True)]

    def predicted(self, names: Sequence[str]) -> Float[np.ndarray, " n"]:
        """What a constant and the named curves say of each residual, fitted to the scenes of the other folds."""
        # Each curve's columns are neighbours, so that no rows are copied.
        blocks = self._blocks(names)
        used = np.r_[tuple(blocks)]
        ends = np.cumsum([block.stop - block.start for block in blocks])
        prediction = np.zeros(len(self.z))
        for k, (part, x, product) in enumerate(zip(self.parts, self.held_out, self.products, strict=True)):
            coefficients = np.linalg.solve(self._gram(k, used), (sum(self.products) - product)[used])
            for block, values in zip(blocks, np.split(coefficients, ends[:-1]), strict=True):
                prediction[part] += x[:, block] @ values
        return prediction

    def _blocks(self, names: Sequence[str]) -> list[slice]:
        """The columns of the constant and of the named curves."""
        return [slice(0, 1), *(self.columns[name] for name in names)]

    def _gram(self, k: int, used: Int[np.ndarray, " k"]) -> Float[np.ndarray, "k k"]:
        """The matrix of a fit to all folds but one, of the columns used."""
        return self.squares[k][np.ix_(used, used)] + RULES.ridge * np.eye(len(used))

    def by_scene(self, before: Float[np.ndarray, " n"], after: Float[np.ndarray, " n"]) -> Float[np.ndarray, " s"]:
        """Held-out gain of each scene from one prediction to another, nats: mostly below 0 where there is nothing to
        find, for it pays for what was fitted to chance."""
        residual = self.z - before
        change = after - before
        # ln N(z; after, 1) - ln N(z; before, 1) = residual · change - change² / 2
        return np.bincount(self.scene, residual * change - 0.5 * change**2, self.scenes)

    def chance_of_best(
        self, taken: Sequence[str], tried: Sequence[str], *, before: Float[np.ndarray, " n"], best: int
    ) -> float:
        """How often chance lets some covariate tried, on top of the prediction `before` of those `taken`, agree with
        what is held out as well as number `best` of them does: trying many is paid for (max-T).

        Chance turns the signs of scenes' residuals and fits each curve to them anew (Freedman & Lane 1983): scenes that
        are in each other's fits gain together, and signs of their gains alone would make them look surer than they are.
        The agreement is the sum of residual times prediction, in units of what it varies by so.
        """
        residual = self.z - before
        products = np.zeros((self.scenes, self.held_out[0].shape[1]))
        for part, x in zip(self.parts, self.held_out, strict=True):
            for scene in np.unique(self.scene[part]):
                of_scene = self.scene[part] == scene
                products[scene] = x[of_scene].T @ residual[part][of_scene]
        without = self._shared(taken, products)
        signs = signs_of(self.scenes)
        agreed = [((signs @ (self._shared([*taken, name], products) - without)) * signs).sum(1) for name in tried]
        scaled = np.stack([sums / (np.sqrt((sums**2).mean()) + 1e-12) for sums in agreed])
        # The first signs turn nothing: what was measured.
        return float(np.mean(~(scaled.max(0) < scaled[best, 0] - ROUNDING)))

    def _shared(self, names: Sequence[str], products: Float[np.ndarray, "s k"]) -> Float[np.ndarray, "s s"]:
        """What each scene (column), by the fit of a constant and the named curves, adds to the agreement of each that
        is held out (row); `products` are those of the scenes' columns with their residuals."""
        used = np.r_[tuple(self._blocks(names))]
        shared = np.zeros((self.scenes, self.scenes))
        for k, part in enumerate(self.parts):
            held_out = np.unique(self.scene[part])
            fitted = np.setdiff1d(np.arange(self.scenes), held_out)
            coefficients = np.linalg.solve(self._gram(k, used), products[np.ix_(fitted, used)].T)
            shared[np.ix_(held_out, fitted)] = products[np.ix_(held_out, used)] @ coefficients
        return shared


def localise(
    rays: Any,
    residuals: Mapping[str, tuple[np.ndarray, np.ndarray]],
    scene: Int[np.ndarray, " b"],
    *,
    most: int = RULES.dependences_tried,
) -> list[Dependence]:
    """Ranks (channel, covariate), strongest first. Within a channel a covariate counts for what it adds to
    those above it. A p-value is that of the strongest of all covariates tried (`Additive.chance_of_best`), times the
    channels.

    `rays` are host arrays (b, c, r); `residuals` gives each channel's standardised residuals and where they count;
    `scene` is that of each block.
    """
    dependences = []
    scenes = len(np.unique(scene))
    for channel, (z, counts) in residuals.items():
        if counts.sum() < RULES.fewest_residuals:
            continue
        index = _scene_index(scene, counts)
        tried = [name for name in COVARIATES if (channel, name) not in READ_OFF]
        designs = {name: curve_basis(values_of(name, rays, counts), name) for name in tried}
        # A covariate of one value, or of no ray, has no curve.
        designs = {name: design for name, design in designs.items() if design.shape[1] > 1}
        # Both would explain the same, and each would hide the other.
        if "time" in designs and _one_clock(rays, counts):
            del designs["time"]
        if "heading" in designs and np.ptp(np.asarray(rays.heading_rad)) == 0:
            del designs["heading"]  # the azimuth, from another zero
        model = Additive(z[counts].astype(np.float64), designs, index, scenes=scenes)
        squares = (model.z**2).sum()
        taken: list[str] = []
        rest = list(designs)
        before = model.predicted(taken)
        while rest and len(taken) < most:
            after = [model.predicted([*taken, name]) for name in rest]
            gains = [model.by_scene(before, prediction).sum() for prediction in after]
            best = int(np.argmax(gains))
            gain = float(gains[best])
            if gain <= 0:
                break
            # The sum of squares falls by twice the gain.
            share = 2 * gain / squares
            if rest[best] == "height" and share < RULES.height_share:
                rest.pop(best)
                continue
            # The channels are a second list of which the best is taken: Bonferroni, for they are only three.
            p = min(1.0, len(residuals) * model.chance_of_best(taken, rest, before=before, best=best))
            dependences.append(Dependence(channel, rest[best], p, share, gain))
            taken.append(rest.pop(best))
            before = after[best]
    return sorted(dependences, key=lambda dependence: -dependence.gain)


def dependences_of(problem: Problem) -> list[Dependence]:
    """On which single covariates the residuals of a fitted problem depend, strongest first."""
    return localise(*standardised(problem), np.asarray(problem.ev.scene))


def reported(dependences: Iterable[Dependence]) -> list[Dependence]:
    """The dependences that a verdict lists, strongest first."""
    sure = [
        dependence
        for dependence in dependences
        if dependence.p_value <= RULES.dependence_level
        and dependence.gain >= RULES.dependence_nats
        and (dependence.channel, dependence.covariate) not in NUISANCES
    ]
    return sorted(sure, key=lambda dependence: -dependence.gain)[: RULES.dependences_listed]


def _one_clock(rays: Any, counts: np.ndarray) -> bool:
    """Whether the time within the scan and the azimuth are one covariate, as in a steady turn: it is called azimuth."""
    time, azimuth = values_of("time", rays, counts), values_of("azimuth", rays, counts)
    return abs(rank_correlation(time, azimuth)) > RULES.one_clock


def _scene_index(scene: Int[np.ndarray, " b"], counts: Bool[np.ndarray, "b c r"]) -> Int[np.ndarray, " n"]:
    """The scene of each ray where `counts`, as its place among those that there are."""
    return np.searchsorted(np.unique(scene), np.broadcast_to(scene[:, None, None], counts.shape)[counts])


def interactions(
    rays: Any,
    residuals: Mapping[str, tuple[np.ndarray, np.ndarray]],
    scene: Int[np.ndarray, " b"],
    *,
    level: float = RULES.dependence_level,
) -> list[Dependence]:
    """Each channel's strongest interaction, as a Dependence on `A x B`, where its p-value, times the channels, is at
    most `level`.

    Arguments as `localise`. Fewer than `Rules.fewest_interaction_scenes` decide nothing.
    """
    dependences = []
    scenes = len(np.unique(scene))
    for channel, (z, counts) in residuals.items():
        counts = _thinned(counts)
        if counts.sum() < RULES.fewest_residuals or scenes < RULES.fewest_interaction_scenes:
            continue
        index = _scene_index(scene, counts)
        # Where losses are rare a few rays hold all the weight, and products of curves would be fitted to them.
        squares = z[counts].astype(np.float64) ** 2
        # Kish 1965: how many equally large residuals have the weight of these.
        if squares.sum() ** 2 / max((squares**2).sum(), 1e-12) < RULES.fewest_effective:
            continue
        designs = {name: curve_basis(values_of(name, rays, counts), name) for name in COVARIATES}
        additive = Additive(z[counts].astype(np.float32), designs, index, scenes=scenes)
        # What one covariate alone says is taken out first: an interaction counts for what only both together tell.
        rest = additive.z - additive.predicted(list(designs))
        curves = {name: _short(values_of(name, rays, counts), name) for name in CROSSED}
        crossed = list(combinations([name for name, curve in curves.items() if curve.shape[1] > 1], 2))
        if not crossed:
            continue
        gains = []
        for a, b in crossed:
            model = Additive(rest, {"product": products(curves[a], curves[b])}, index, scenes=scenes)
            gains.append(model.by_scene(np.zeros(len(rest)), model.predicted(["product"])))
        best, p = best_of_gains(np.stack(gains))
        # As in `localise`: the best of the channels' is listed.
        p = min(1.0, len(residuals) * p)
        if p <= level:
            share = float(2 * gains[best].sum() / (rest.astype(np.float64) ** 2).sum())
            # Of all residuals, where only some were tried.
            scale = (residuals[channel][1].sum() / counts.sum()).item()
            dependences.append(
                Dependence(channel, " x ".join(crossed[best]), p, share, float(gains[best].sum() * scale))
            )
    return dependences


def _thinned(counts: Bool[np.ndarray, "b c r"]) -> Bool[np.ndarray, "b c r"]:
    """Every so manieth of the cells that count, `Rules.interaction_residuals` at most."""
    cells = np.flatnonzero(counts)
    chosen = np.zeros(counts.size, bool)
    chosen[cells[:: max(1, -(-len(cells) // RULES.interaction_residuals))]] = True
    return chosen.reshape(counts.shape)


def _short(x: np.ndarray, name: str) -> Float[np.ndarray, "n k"]:
    """A curve of few knots: a product of two has the product of their numbers. Only classes keep a column each."""
    return curve_basis(x, name if name == "class" else "", RULES.interaction_knots)


@dataclass(frozen=True)
class Dependences:
    """What the find scenes show before any effect is added."""

    null_model: NullModel
    single: list[Dependence]
    """Dependences of the null's residuals on single covariates, strongest first."""
    where: tuple[Where, ...]
    """The dependences that a verdict lists, interactions among them."""
    crossed: tuple[Dependence, ...]
    """Interactions of two covariates that are sure enough for it, `A x B`."""


def find_dependences(division: Division, known: SensorModel = NOTHING_YET) -> Dependences:
    """The null model with the `known` effects in place, and what its residuals depend on. Raises ValueError for a
    learned law of what the frames do not hold."""
    null_model = NullModel.of(division, known)
    rays, residuals = standardised(null_model.problem)
    scene = np.asarray(null_model.problem.ev.scene)
    single, crossed = side_by_side(
        partial(localise, rays, residuals, scene), partial(interactions, rays, residuals, scene)
    )
    listed = reported([*single, *crossed])
    where = tuple(Where(found.channel, spelled(found.covariate), found.p_value, found.share) for found in listed)
    return Dependences(null_model, single, where, tuple(reported(crossed)))
