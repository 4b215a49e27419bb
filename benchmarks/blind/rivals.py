"""What simpler methods would answer to the same case, from the same fits."""

from __future__ import annotations

from typing import Any

import numpy as np

from jaxsim.discover import Result
from jaxsim.discover.name.candidates import Candidate
from jaxsim.discover.rules import RULES
from jaxsim.effects import EFFECTS

RIVALS = {
    "always none": "never names anything",
    "single best covariate": "the strongest dependence of the residuals; the effect that the catalogue lists for it",
    "in-sample likelihood": "the largest likelihood on the scenes that were fitted",
    "BIC": "the same less half a logarithm of the number of rays for every parameter; none below 0",
    "held-out likelihood": "the largest likelihood on scenes that were not fitted; no bar, no test",
}
"""By name, what each goes by."""


def rival_answers(result: Result, rays: int) -> dict[str, list[str]]:
    """Each rival's names, at most one; `rays` are those that all find scenes show."""
    seen = rays * (1 - 1 / RULES.folds)
    inside = max(result.candidates, key=lambda c: c.inside)
    bic = max(result.candidates, key=lambda c: _bic(c, seen))
    held_out = result.candidates[0]
    return {
        "always none": [],
        "single best covariate": best_covariate(result.verdict.to_json()["where"]),
        "in-sample likelihood": [inside.effect.name] if inside.inside > 0 else [],
        "BIC": [bic.effect.name] if _bic(bic, seen) > 0 else [],
        "held-out likelihood": [held_out.effect.name] if held_out.total > 0 else [],
    }


def parameters_of(candidate: Candidate) -> float:
    """Values that the data moved, mean of the folds: a class or a beam that no ray shows costs nothing."""
    moved = [sum(int((np.abs(np.asarray(z)) > 1e-3).sum()) for z in fit.z.values()) for fit in candidate.fits]
    return float(np.mean(moved))


def _bic(candidate: Candidate, seen: float) -> float:
    """Nats over the null: gain in the fit less ln(n) / 2 a parameter."""
    return candidate.inside - 0.5 * max(parameters_of(candidate), 1.0) * np.log(seen)


def best_covariate(where: list[dict[str, Any]]) -> list[str]:
    """The effect that lists the first place's channel and covariate as its own; of several the one that lists the
    fewest, for it is the most specific, and then the first of the catalogue."""
    if not where:
        return []
    place = where[0]
    fitting = [e for e in EFFECTS.values() if place["channel"] in e.channels and place["covariate"] in e.covariates]
    fitting.sort(key=lambda effect: len(effect.channels) * len(effect.covariates))
    return [fitting[0].name] if fitting else []


def judge_rival(row: dict[str, Any], answer: list[str]) -> dict[str, Any]:
    """Whether an answer of bare names is right: nothing for none, the hidden name first for one effect, exactly the
    set for several. A kind outside the catalogue has no right name; `named` is what counts there."""
    truth = [] if row["kind"] in ("none", "outside") else row["truth"]
    hits = len(set(answer) & set(truth))
    return {
        "named": bool(answer),
        "right": {"none": not answer, "single": answer[:1] == truth, "outside": False}.get(
            row["kind"], set(answer) == set(truth)
        ),
        "f1": 2 * hits / (len(set(answer)) + len(truth)) if answer or truth else None,
    }
