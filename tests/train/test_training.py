"""Batches that are made ahead are those that were asked for."""

import pytest

from jaxsim.train.training import ahead


class Squares:
    """Batch k is k squared; the seventh is damaged."""

    def __getitem__(self, k: int) -> int:
        if k == 7:
            raise ValueError("record 7 is damaged")
        return k * k


@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize(("start", "stop"), [(0, 7), (2, 6), (5, 6), (6, 6)])
def test_batches_made_ahead_are_those_asked_for_one_by_one(start, stop, threads):
    assert list(ahead(Squares(), start, stop, threads=threads)) == [k * k for k in range(start, stop)]


def test_what_spoils_a_batch_is_told_when_its_turn_comes():
    made = ahead(Squares(), 5, 9)
    assert [next(made), next(made)] == [25, 36]
    with pytest.raises(ValueError, match="record 7 is damaged"):
        next(made)
