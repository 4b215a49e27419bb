"""Scores of a run."""

from jaxsim.config import RunConfig
from jaxsim.evaluate.intensity import baseline_sums
from jaxsim.evaluate.runs import mean_words, scores_by_scene
from jaxsim.metrics.paired import total_scores
from tests.evaluate.made import street


def test_scores_come_scene_by_scene():
    judged = [street(seed) for seed in range(10, 14)]
    sums = baseline_sums([street(0), street(1)], judged, [None] * len(judged))
    found = scores_by_scene(sums | {"network": sums["global mean"]}, ["a", "a", "b", "b"])
    assert list(found) == ["a", "b"]
    assert found["a"]["per-row median"] == total_scores(sums["per-row median"][:2])


def test_a_mean_of_five_epochs_needs_no_excuse_and_one_of_fewer_says_why():
    epochs = RunConfig(save_every=0, keep=5)
    assert mean_words([5, 10, 15, 20, 25], epochs).endswith("the last 5 epochs (steps 5, 10, 15, 20, 25)")
    assert mean_words([5, 10], epochs).endswith(
        "the last 2 epochs (steps 5, 10); the paper's is of 5 (no more are there)"
    )
