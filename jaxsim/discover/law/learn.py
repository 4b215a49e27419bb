"""Learn: what no effect describes, as a law of knots and heights that enters the sensor model with its uncertainty.

The free curve that won (`name.unexplained`) becomes a `Learned` law: the same basis written down at its knots, so that
rays between them and beyond them have a height too. Where a pair of covariates clearly says more than the
curve's alone, the law is a product of the two. Letters: k knots, m numbers that are fitted, g groups of scenes.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jaxsim.discover.find.covariates import COVARIATES, CURVES, Dependence, parts_of, product_knots, with_basis
from jaxsim.discover.model.fit import NULL_ENOUGH, Fit, Problem, fit, in_place
from jaxsim.discover.model.null_model import refit, refitted
from jaxsim.discover.model.parameters import to_values, to_z
from jaxsim.discover.name.candidates import THREADS, Candidate, rank_effects
from jaxsim.discover.name.unexplained import agreed, at_knots
from jaxsim.discover.rules import RULES
from jaxsim.discover.scenes import clipped, folds, jackknife_sd, p_value
from jaxsim.effects import Law
from jaxsim.effects.learned import CHANGE, LIMITS, TABLES, Learned, Numbers, curve_kind
from jaxsim.products import matmul


@dataclass(frozen=True)
class Form:
    """A law before it is fitted: where its knots lie, and what of it is free."""

    bare: Learned
    """The law with heights of 0."""
    basis: Float[np.ndarray, "k m"]
    """Heights at the knots are its product with the numbers that are fitted."""
    start: Float[np.ndarray, " m"]
    """The numbers at which its fit begins."""

    @classmethod
    def of(cls, problem: Problem, dependence: Dependence, curve: Candidate) -> Form:
        """The form of a free curve that was fitted to the problem's rays."""
        names = parts_of(dependence.covariate)
        if len(names) > 1:
            return cls.of_product(problem, dependence.channel, names, curve=curve)
        _, knots, basis, heights = at_knots(problem, dependence, curve)
        # Columns that only fill up have no height to fit.
        used = basis.any(0)
        numbers = tuple(knots.tolist())
        nothing = (0.0,) * len(knots)
        bare = Learned(
            dependence.channel,
            curve_kind(dependence.covariate, numbers),
            (dependence.covariate,),
            (numbers,),
            nothing,
            nothing,
            adds=dependence.adds,
        )
        return cls(bare, basis[:, used], np.mean(heights, axis=0)[used])

    @classmethod
    def of_product(cls, problem: Problem, channel: str, names: tuple[str, ...], *, curve: Candidate) -> Form:
        """The form of a curve along a product of two covariates."""
        knots = product_knots(problem, names)
        size = len(knots[0]) * len(knots[1])
        nothing = (0.0,) * size
        heights = [np.asarray(values["height"])[:size] for values in curve.fitted_values]
        bare = Learned(channel, "product", names, tuple(map(_plain, knots)), nothing, nothing)
        return cls(bare, np.eye(size, dtype=np.float32), np.mean(heights, axis=0))

    @property
    def law(self) -> Law:
        """The law whose parameter is what is free: fitted like any effect, by the program that sensor.json's runs."""
        bare, basis = self.bare, jnp.asarray(self.basis, jnp.float32)
        height = replace(CURVES[bare.change].parameters["height"], columns=len(self.start))
        # Laws are told apart by name: another run's knots make another law.
        mark = hashlib.sha256(repr(bare).encode() + self.basis.tobytes()).hexdigest()[:12]
        return Law(
            name=f"{bare.name} ({mark})",
            parameters={"height": height},
            channels=(bare.channel,),
            apply=lambda p, rays: CHANGE[bare.change](rays, bare.height(rays, matmul(basis, p["height"]))),
            # A law of the reported intensity would be fitted to the measured one; this is one of the predicted.
            covariates=tuple(name for name in bare.covariates if name in COVARIATES and name != "intensity"),
        )

    def heights(self, result: Fit) -> Float[np.ndarray, " k"]:
        """A fit's height at each knot, within LIMITS."""
        numbers = np.asarray(to_values(self.law, result.z)["height"], np.float64)
        return np.clip(self.basis.astype(np.float64) @ numbers, *LIMITS[self.bare.change])


@dataclass(frozen=True)
class LearnedFit:
    """A fitted law and what groups of scenes say of it."""

    learned: Learned
    without: Float[np.ndarray, "g k"]
    """The law's heights with each group of the find scenes left out."""
    free: int
    """How many numbers were fitted."""


def curve_form(
    problem: Problem,
    dependence: Dependence,
    curve: Candidate,
    *,
    crossed: Sequence[Dependence] = (),
    bar: float = RULES.bar_nats,
) -> Form:
    """The form of a free curve, or of the product with another covariate (`crossed` of its channel, `A x B`) that
    clearly gains more: as much more as a free curve must gain over named effects (`Rules.curve_factor`)."""
    form = Form.of(problem, dependence, curve)
    least = RULES.curve_factor * curve.total + RULES.curve_margin_nats
    for product in crossed:
        names = parts_of(product.covariate)
        if product.channel != dependence.channel or dependence.covariate not in names or set(names) & set(TABLES):
            continue
        tried = with_basis(problem, product.covariate)
        [candidate] = rank_effects(tried, [CURVES[dependence.channel]], null_fits=problem.null_fits)
        # Scene by scene as well: a few scenes could make the total.
        better = p_value(clipped(candidate.by_scene - curve.by_scene)) <= RULES.alike_level
        if agreed(candidate, bar) and candidate.total > least and better:
            form = Form.of(problem, product, candidate)
            least = candidate.total
    return form


def learn(form: Form, problem: Problem, result: Fit) -> LearnedFit:
    """The law of a fit to all find scenes, with the standard deviation of each knot by the jackknife: fitted again
    without each of at most `Rules.learned_groups` groups of scenes."""
    law = form.law
    start = {"height": np.asarray(to_values(law, result.z)["height"])}

    def left_out(mask: Float[np.ndarray, " b"]) -> Float[np.ndarray, " k"]:
        # Leaving few scenes out gains little: a fit that is content with little would stay where it began.
        return form.heights(fit(law, problem, mask, starts=(start,), enough=NULL_ENOUGH))

    with ThreadPoolExecutor(THREADS) as pool:
        masks = folds(np.asarray(problem.ev.scene), RULES.learned_groups)
        without = np.stack(list(pool.map(left_out, masks)))
    values, sd = form.heights(result), jackknife_sd(without)
    return LearnedFit(replace(form.bare, values=_plain(values), sd=_plain(sd)), without, len(form.start))


def ranked_beside(
    null: Problem, curve: tuple[Dependence, Candidate], effects: Sequence[Law], *, bar: float
) -> list[Candidate]:
    """What `effects` still gain with the law of a free curve in place, fitted to all find scenes; `bar` is that of
    `rank_effects`."""
    form = Form.of(null, *curve)
    start = to_z(form.law, {"height": form.start}, null.ev.rays.row.shape[-1])
    [law] = refit(null, [form.law], [start])
    beside = refitted(in_place(null, [(law.effect, law.fit.z)]))
    return rank_effects(beside, effects, bar=bar)


def _plain(numbers: Float[np.ndarray, " k"]) -> Numbers:
    return tuple(map(float, numbers))
