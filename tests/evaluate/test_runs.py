"""Scores of a run."""

from jaxsim.evaluate.intensity import baseline_sums
from jaxsim.evaluate.runs import scores_by_scene
from jaxsim.metrics.paired import total_scores
from tests.evaluate.made import street


def test_scores_come_scene_by_scene():
    judged = [street(seed) for seed in range(10, 14)]
    sums = baseline_sums([street(0), street(1)], judged, [None] * len(judged))
    found = scores_by_scene(sums | {"network": sums["global mean"]}, ["a", "a", "b", "b"])
    assert list(found) == ["a", "b"]
    assert found["a"]["per-row median"] == total_scores(sums["per-row median"][:2])
