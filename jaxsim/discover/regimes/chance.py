"""Whether an effect is stronger in some region by more than chance: exact tests over scenes, best of all regions.

Where regions are made of whole scenes, scenes are exchangeable if nothing divides them: their excesses are dealt out
anew. Where regions run through every scene (sectors), each scene's contrast is as likely as its negative: scenes change
signs. Either way the best of a question's regions is held against the best under each draw (max-T), which pays for
having looked at all. (`find` keeps false discoveries rare over all questions.)

    best_region     a question about an effect that is named, by its cells
    scenes_by_size  drives that only their own readings tell apart: some have the effect, others have not
    disputed        candidates that no test over all scenes accepts: an effect in half of the scenes gains there and
                    loses elsewhere, but the scenes on which it gains lie on one side of a moment, or share a tag. Rates
                    are what each scene says, unseen by the fit, of the direction of a candidate (`Candidate.slope`)
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxsim.discover.name.candidates import Candidate
from jaxsim.discover.regimes.cells import Cells
from jaxsim.discover.regimes.questions import Facts, Question
from jaxsim.discover.rules import RULES
from jaxsim.discover.scenes import chance_of, clipped, dealt, orders_of, p_value, scaled_groups, signs_of, strongest
from jaxsim.effects.region import Region


class FoundRegion(NamedTuple):
    """The region of a question in which an effect is most clearly stronger than outside."""

    question: Question
    k: int
    p_value: float


def best_region(question: Question, of: Cells, scene: Int[np.ndarray, " b"]) -> FoundRegion:
    """The best region and how often chance makes some region of the question as good."""
    whole = question.between_scenes(scene)
    if whole is None:
        best, p = flipped(*_contrasts(question, of, scene))
    else:
        best, p = dealt(np.bincount(scene, of.excess.sum(1)), whole)
    return FoundRegion(question, best, p)


def _contrasts(
    question: Question, of: Cells, scene: Int[np.ndarray, " b"]
) -> tuple[Float[np.ndarray, "k n"], Float[np.ndarray, " k"]]:
    """Gives by how much each region's slope exceeds its share of each scene's, and how far that may be by chance."""

    def by_scene(part: Float[np.ndarray, "b a"]) -> Float[np.ndarray, " n"]:
        return np.bincount(scene, part.sum(1), int(scene.max()) + 1)

    excess = by_scene(of.excess)
    curvature = by_scene(of.curvature)
    squares = by_scene(of.squares)
    rows: list[Float[np.ndarray, " n"]] = []
    variance: list[float] = []
    for region in question.inside:
        weight = by_scene(of.curvature * region)
        # A scene that asks for more of the effect everywhere asks for no region.
        share = weight / curvature
        rows.append(by_scene(of.excess * region) - share * excess)
        inside = by_scene(of.squares * region)
        scattered = (1 - share) ** 2 * inside + share**2 * (squares - inside)
        variance.append(float(np.maximum(weight * (1 - share), scattered).sum()))
    # A region in which nothing bends must not be divided by 0.
    return np.stack(rows), np.maximum(np.array(variance), 1e-9)


def flipped(contrasts: Float[np.ndarray, "k n"], variance: Float[np.ndarray, " k"]) -> tuple[int, float]:
    """The region that scenes' contrasts speak for most, and how often some region's do when scenes change their signs;
    no scene counts for more than the third largest. The variances are those of the sums, and do not change with the
    signs."""
    # In units of its standard deviation: a wide region does not win by its size alone. Nor does a narrow one by the few
    # scenes that have rays in it.
    gains = np.stack([clipped(one) for one in contrasts / np.sqrt(variance)[:, None]])
    best = int(gains.sum(1).argmax())
    by_chance = strongest(gains, signs_of(contrasts.shape[1]))
    return best, float(np.mean(by_chance >= gains[best].sum() - 1e-9))


def scenes_by_size(of: Cells, facts: Facts) -> FoundRegion | None:
    """The scenes whose own sizes are large; `of` holds even and odd columns of each sector apart (2 a + parity).

    Scenes that differ by noise alone differ in both halves of their columns to the same side as often as not. The
    division is the widest gap between sizes. None for a single drive, and for few.
    """
    few = RULES.regime_fewest_scenes
    if len(set(facts.names)) < 2 or facts.few_drives or facts.scene_count < 2 * few:
        return None
    excess = _by_half(of.excess, facts)
    curvature = _by_half(of.curvature, facts)
    p = likeness_p_value(excess[0], excess[1])
    size = excess.sum(0) / np.maximum(curvature.sum(0), 1e-9)
    order = np.argsort(-size)
    # The widest gap between neighbours in size that leaves enough scenes on both sides.
    count = few + int(np.argmax(-np.diff(size[order])[few - 1 : facts.scene_count - few]))
    inside = np.isin(np.arange(facts.scene_count), order[:count])
    names = {n: facts.names[facts.frame[np.argmax(facts.scene == n)]] for n in range(facts.scene_count)}
    region = Region(scenes=tuple(sorted(names[n] for n in np.flatnonzero(inside).tolist())))
    masks = inside[facts.scene][None, :, None]
    return FoundRegion(Question("scene", (region,), masks), 0, p)


def likeness_p_value(first: Float[np.ndarray, " n"], second: Float[np.ndarray, " n"]) -> float:
    """How often scenes resemble themselves so well if each resembles and contradicts itself alike; no scene counts for
    more than the third largest.

    Halves are not dealt out anew: scenes that tell little scatter more in both, and would resemble themselves so."""
    # About the median, which the wildest do not move, and then about the mean of what is left of them.
    a = clipped(first - np.median(first))
    b = clipped(second - np.median(second))
    return p_value(clipped((a - a.mean()) * (b - b.mean())))


def _by_half(part: np.ndarray, facts: Facts) -> np.ndarray:
    """Gives the sums over each scene's even columns, and over its odd ones (2, n)."""
    return np.stack([np.bincount(facts.scene, part[:, half::2].sum(1), facts.scene_count) for half in (0, 1)])


class Disputed(NamedTuple):
    """A region that divides the scenes of some candidates."""

    finding: FoundRegion
    candidates: tuple[Candidate, ...]
    """The candidates, those that it makes clearest first."""
    exists: bool
    """Whether some candidate's scenes agree better in some region than they would if there were nothing at all."""


def disputed(candidates: Sequence[Candidate], asked: Sequence[Question], facts: Facts) -> list[Disputed]:
    """Gives the best region over all candidates, for each question whose regions are made of whole scenes."""
    tried = [candidate for candidate in candidates if not candidate.effect.of_recording and candidate.slope.any()]
    if not tried:
        return []
    rates = np.stack([clipped(candidate.slope) for candidate in tried])
    result = []
    for question in asked:
        whole = question.between_scenes(facts.scene)
        if whole is None:
            continue
        k, strength, p = divided(rates, whole)
        order = [tried[c] for c in np.argsort(-strength[:, k])]
        sure = p <= RULES.regime_level and existing(rates, whole) <= RULES.agreement_level
        result.append(Disputed(FoundRegion(question, k, p), tuple(order), sure))
    return result


def _in_units(rates: Float[np.ndarray, "c n"]) -> Float[np.ndarray, "c n"]:
    """Each candidate's rates over their root mean square, and over `Rules.regime_least_rate`: the many candidates of
    which no scene says anything are each divided perfectly by some region."""
    return rates / np.hypot(np.sqrt((rates**2).mean(1, keepdims=True)), RULES.regime_least_rate)


def divided(
    rates: Float[np.ndarray, "c n"], whole: Bool[np.ndarray, "k n"]
) -> tuple[int, Float[np.ndarray, "c k"], float]:
    """The region that divides some candidate's scenes most, how clearly each does each candidate's, and how often
    scenes that are dealt out anew, all candidates alike, are divided as clearly."""
    off = _in_units(rates - rates.mean(1, keepdims=True))
    scaled = scaled_groups(whole).T
    strength = off @ scaled
    by_chance = np.array([(off[:, order] @ scaled).max() for order in orders_of(rates.shape[1])])
    return int(strength.max(0).argmax()), strength, chance_of(by_chance, strength.max())


def existing(rates: Float[np.ndarray, "c n"], whole: Bool[np.ndarray, "k n"]) -> float:
    """How often scenes without anything in them, which may change places and signs, agree so well in some region."""
    scaled = (whole / np.sqrt(whole.sum(1))[:, None]).T
    direction = _in_units(rates)
    # Of its own: orders are drawn with seed 0.
    rng = np.random.default_rng(1)
    scenes = rates.shape[1]
    # Places and signs both change: where there is nothing, neither says anything.
    by_chance = [(direction[:, order] * rng.choice([-1.0, 1.0], scenes) @ scaled).max() for order in orders_of(scenes)]
    return chance_of(np.array(by_chance), (direction @ scaled).max())
