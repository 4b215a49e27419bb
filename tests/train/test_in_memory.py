"""Training in memory: a step on each batch, and its end."""

import pytest

from jaxsim.train.in_memory import descend


def halve(value: float, batch: float, k: int) -> tuple[float, float]:
    """Goes half the way to the batch's number; the step's number is added."""
    return value + (batch - value) / 2 + k, abs(batch - value)


def test_every_batch_makes_one_step_and_steps_are_counted():
    assert descend(halve, 8.0, [0.0, 0.0, 0.0], steps=3, by="test") == ((8 / 2) / 2 + 1) / 2 + 2


def test_without_a_batch_nothing_is_learned():
    assert descend(halve, 8.0, [], steps=0, by="test") == 8.0


@pytest.mark.parametrize("loss", [float("nan"), float("inf")])
def test_a_loss_that_is_not_finite_stops_at_once(loss):
    steps = []

    def diverge(state: int, batch: float, k: int) -> tuple[int, float]:
        steps.append(k)
        return state, batch

    with pytest.raises(ValueError, match=r"test: the loss of step 1 is (nan|inf); lower the rate"):
        descend(diverge, 0, [1.0, loss, 1.0], steps=3, by="test")
    assert steps == [0, 1]
