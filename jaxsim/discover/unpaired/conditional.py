"""The comparison of ln I given what both range images say: the law, what may differ anyway, and the terms that may
stand for an effect.

Letters as in equations.py: n rays, s scenes, l columns of the law, k of the measured side, o of what is a scene's own.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxsim.discover.model.evidence import CLASS_SD
from jaxsim.discover.rules import RULES
from jaxsim.discover.scenes import MEDIAN_TO_SD
from jaxsim.discover.unpaired.columns import (
    FREE_PRECISION,
    OF_CLASSES,
    OF_INTENSITY,
    Columns,
    change_of,
    columns_of,
    curve_columns,
    kinds,
    law_columns,
    one_hot,
    patches,
    ray_classes,
    scene_columns,
)
from jaxsim.discover.unpaired.equations import (
    LAW_PULL,
    Block,
    Equations,
    RandomEffects,
    Solution,
    equations,
    freedom,
    lowered,
    solve,
)
from jaxsim.discover.unpaired.read import UnpairedComparison
from jaxsim.effects import EFFECTS
from jaxsim.effects.rays import LEAST_M, REFERENCE_M, Rays
from jaxsim.metrics.intervals import student_reach

GROUND_PATCH_SD = 0.25
"""Standard deviation of the level of a patch of ground, nats."""
SCENE_SD = (0.3, 0.2, 0.3, 0.1)
"""Standard deviations of a scene's level, and of its slopes over ln r, incidence (rad) and height (m), for each kind of
surface."""
LAW_CURVATURE_SD = 0.003
"""Standard deviation of the coefficient of 0.5 sec(incidence)**2, which noise on normals leaves."""
CURVE_SD = 0.15
"""Standard deviation of a free curve's knots, nats."""
READING_QUANTILES = (0.1, 0.3, 0.5, 0.7, 0.9)
"""The quantiles at which the simulator's readings about the law stand for all of them: effects are not linear in ln
I."""
DRAWS = 200
"""Draws of the bootstrap over scenes, for a standard deviation."""
INFLATION_DRAWS = 40
"""Exchanges of scenes from which the inflation of losses is taken."""


@dataclass(frozen=True)
class Term:
    """Something that the measured side may have: an effect of the catalogue, one start of it, or a free curve."""

    name: str
    """The effect's, or the free curve's covariate."""
    columns: Columns
    block: Block


@dataclass(frozen=True)
class Conditional:
    """All scenes of both sides as normal equations, and what gives them meaning."""

    comparison: UnpairedComparison
    y: Float[np.ndarray, " n"]
    """ln I, clipped."""
    law: Float[np.ndarray, "n l"]
    side: Float[np.ndarray, "n k"]
    """Columns of the measured side: nuisances, terms, curves."""
    random: RandomEffects
    equations: Equations
    nuisance: Block
    terms: tuple[Term, ...]
    curves: tuple[Term, ...]
    rays: Rays
    """Intensities are the law's."""
    spread: Float[np.ndarray, " q"]
    """Quantiles of simulated readings about the law at READING_QUANTILES, nats."""
    find: Bool[np.ndarray, " s"]
    variance: float
    """Variance of readings within a patch, nats squared."""
    inflation: float
    """Factor by which the losses of exchanged scenes scatter than independent noise would have them."""

    @property
    def measured(self) -> Float[np.ndarray, " s"]:
        """1 for measured scenes, 0 for simulated ones."""
        return self.comparison.measured.astype(float)

    @property
    def weight(self) -> Float[np.ndarray, " s"]:
        """1 for scenes to find with, 0 for those to judge on."""
        return self.find.astype(float)

    def resampled(self) -> Iterator[Float[np.ndarray, " s"]]:
        """Weights of find scenes drawn with replacement, DRAWS times: rays of one scene are no independent witnesses.
        Both sides are drawn apart, as many scenes of each as there are."""
        rng = np.random.default_rng(0)
        for _ in range(DRAWS):
            drawn = np.concatenate([rng.choice(scenes, len(scenes)) for scenes in self._by_side()])
            yield np.bincount(drawn, minlength=len(self.find)).astype(float)

    @property
    def reach(self) -> float:
        """Half width of a 90 % interval over the standard deviation of what `resampled` scenes give."""
        fewest = min(len(scenes) for scenes in self._by_side())
        # A bootstrap's variance is (n - 1) / n of what it stands for; t makes up for knowing it from n scenes only.
        return float(np.sqrt(fewest / (fewest - 1)) * student_reach(fewest))

    def _by_side(self) -> list[Int[np.ndarray, " _"]]:
        """The find scenes of each side."""
        return [np.flatnonzero(self.find & (self.measured == side)) for side in (0, 1)]

    def solved(
        self, blocks: Sequence[Block], eq: Equations | None = None, weight: Float[np.ndarray, " s"] | None = None
    ) -> Solution:
        """The nuisances and further `blocks` fitted to the find scenes, or to scenes of another `weight`, by other
        equations where these are given."""
        pooled = (eq or self.equations).pooled(self.weight if weight is None else weight, self.measured)
        return solve(pooled, [self.nuisance, *blocks])


def compare(
    comparison: UnpairedComparison, find: Bool[np.ndarray, " s"], draws: Float[np.ndarray, "d s"]
) -> Conditional:
    """The comparison with everything that is learned (law, clipping, class mixture) from the `find` scenes; `draws` are
    exchanges of the sides (equations.exchanged)."""
    scene = comparison.scene
    sensed = comparison.measured[scene]
    # Judge scenes shape nothing, not even what clips their readings.
    learn = find[scene]
    kind = kinds(comparison)
    # Streets differ, the law of ln I given what a ray meets does not: that is what both sides share.
    law = law_columns(comparison, kind)
    # A few readings of glass and of signs would bend the law of all others.
    y = _clipped(comparison.log_intensity, law, learn, sensed=sensed)
    patch = patches(comparison, kind)
    variance = _within(y - law @ _ridge(law[learn], y[learn]), patch, learn)
    random = RandomEffects(scene_columns(comparison, kind), np.repeat(SCENE_SD, 3), patch, GROUND_PATCH_SD)

    def equations_of(side: np.ndarray) -> Equations:
        return equations(y, law, side, random=random, scene=scene, scenes=len(comparison.scenes), variance=variance)

    # How much of each class, and what intensity, the simulated side has at given covariates.
    simulated = learn & ~sensed
    mixture = one_hot(ray_classes(comparison), _common(ray_classes(comparison)[simulated]))
    # Regressed on the law's columns: class shares and ln I, as the simulated side has them there.
    by_law = equations_of(np.concatenate([mixture, y[:, None]], axis=1))
    expected = law @ _regressed(by_law, (find & ~comparison.measured).astype(float))
    predicted = expected[:, -1]
    spread = np.quantile((y - predicted)[simulated], READING_QUANTILES)
    # The law is the readings' mean: what stands for them must lie about it.
    spread = spread - spread.mean()
    rays = _rays_by_law(comparison.rays, predicted)

    # What may differ without any effect, then what may be one: columns beside one another. Classes are known where both
    # sides know them.
    nuisance, block = _nuisances(comparison, mixture if comparison.shared_classes else expected[:, :-1])
    terms = _terms(comparison, rays, spread, first=nuisance.shape[1])
    side = np.concatenate([nuisance, *(term.columns.columns for term in terms)], axis=1)
    eq = equations_of(side)
    inflation = _inflation(eq, find.astype(float), draws, nuisance=block, blocks=[term.block for term in terms])
    return Conditional(
        comparison=comparison,
        y=y,
        law=law,
        side=side,
        random=random,
        equations=eq.scaled(inflation),
        nuisance=block,
        terms=tuple(term for term in terms if term.columns.effect),
        curves=tuple(term for term in terms if not term.columns.effect),
        rays=rays,
        spread=spread,
        find=find,
        variance=variance,
        inflation=inflation,
    )


def _rays_by_law(rays: Rays, predicted: Float[np.ndarray, " n"]) -> Rays:
    """The rays with the intensity that the law says, and the power that goes with it."""
    power = predicted - 2 * np.log(np.maximum(rays.range_m, LEAST_M) / REFERENCE_M)
    said = predicted.astype(np.float32)
    return replace(rays, log_intensity=said, met_log_intensity=said, log_power=power.astype(np.float32))


def _nuisances(
    comparison: UnpairedComparison, of_classes: Float[np.ndarray, "n c"]
) -> tuple[Float[np.ndarray, "n k"], Block]:
    """What may differ without any effect: overall gain, reflectances of classes, and how normals scatter."""
    # Noise on a normal of variance v lowers the mean of ln cos by v / 2 sec^2: its second-order term.
    bend = 0.5 / np.cos(comparison.rays.incidence_rad)[:, None] ** 2
    columns = np.concatenate([np.ones((len(bend), 1)), of_classes, bend], axis=1).astype(np.float32)
    precision = np.array([FREE_PRECISION, *[1 / CLASS_SD**2] * of_classes.shape[1], 1 / LAW_CURVATURE_SD**2])
    return columns, Block(np.arange(columns.shape[1]), precision)


def _terms(comparison: UnpairedComparison, rays: Rays, spread: Float[np.ndarray, " q"], *, first: int) -> list[Term]:
    """What may be an effect, then free curves; their columns stand one after the other within the side's, from `first`
    on."""
    rows = comparison.rows
    parts: list[tuple[str, Columns]] = []
    # Effects of single classes cannot be told where one side does not say which class a ray meets.
    for name in (*OF_INTENSITY, *(OF_CLASSES if comparison.shared_classes else ())):
        change = change_of(EFFECTS[name], rays, rows, spread=spread)
        parts += [(name, columns) for columns in columns_of(EFFECTS[name], change, rays.row, rows=rows)]
    for name, basis in curve_columns(comparison).items():
        parts.append((name, Columns(None, {}, basis, np.full(basis.shape[1], 1 / CURVE_SD**2))))
    terms = []
    for name, columns in parts:
        end = first + columns.columns.shape[1]
        terms.append(Term(name, columns, Block(np.arange(first, end), columns.precision, columns.sign)))
        first = end
    return terms


def _common(classes: Int[np.ndarray, " n"]) -> Int[np.ndarray, " c"]:
    """The classes that are not rare."""
    values, counts = np.unique(classes, return_counts=True)
    return values[counts > RULES.unpaired_rare_share * counts.sum()]


def _regressed(eq: Equations, weight: Float[np.ndarray, " s"]) -> Float[np.ndarray, "l k"]:
    """Coefficients of the law for each column of a side, of so weighted scenes."""
    n = eq.law
    return np.linalg.solve(eq.of_law(weight), np.einsum("s,spq->pq", weight, eq.gram[:, :n, n:]))


def _ridge(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    x = x.astype(np.float64)
    return np.linalg.solve(x.T @ x + LAW_PULL * np.eye(x.shape[1]), x.T @ y)


def _clipped(y: np.ndarray, law: np.ndarray, learn: np.ndarray, *, sensed: np.ndarray) -> Float[np.ndarray, " n"]:
    """Readings held within `Rules.unpaired_held_sd` of their side's own law."""
    y = y.copy()
    for side in (sensed, ~sensed):
        for _ in range(2):
            middle = law[side] @ _ridge(law[side & learn], y[side & learn])
            off = y[side] - middle
            reach = RULES.unpaired_held_sd * MEDIAN_TO_SD * np.median(np.abs(off[learn[side]]))
            y[side] = middle + np.clip(off, -reach, reach)
    return y


def _within(off: np.ndarray, patch: np.ndarray, learn: np.ndarray) -> float:
    """Variance of readings about their patch's mean."""
    _, number, count = np.unique(patch[learn], return_inverse=True, return_counts=True)
    mean = np.bincount(number, off[learn]) / count
    squares = (off[learn] - mean[number]) ** 2
    # Each patch's mean costs a degree of freedom.
    return float(squares.sum() / max((count - 1).sum(), 1))


def _inflation(
    eq: Equations,
    weight: Float[np.ndarray, " s"],
    draws: Float[np.ndarray, "d s"],
    *,
    nuisance: Block,
    blocks: Sequence[Block],
) -> float:
    """Median over blocks of what exchanged sides lower the loss by, over what independent noise would give (half the
    block's degrees of freedom); 1 where no block says anything of it."""
    # The first draw is the true division, which an effect may lower.
    exchanges = draws[1 : 1 + INFLATION_DRAWS]
    chance = lowered(eq, exchanges, blocks, weight=weight, nuisance=nuisance).mean(0)
    free = np.array([freedom(eq, block, weight=weight, measured=draws[0]) for block in blocks])
    # A block that its prior holds still says nothing of the noise.
    use = free > 0.5
    return float(max(np.median(2 * chance[use] / free[use]), 1.0)) if use.any() else 1.0
