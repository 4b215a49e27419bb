"""What is made ahead is what was asked for, in order, and no more of it."""

from concurrent.futures import ThreadPoolExecutor
from threading import Event

import pytest

from jaxsim.prefetch import prefetch


def square(k: int) -> int:
    if k == 7:
        raise ValueError("item 7 is damaged")
    return k * k


@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("ahead", [0, 1, 4, 9])
@pytest.mark.parametrize("count", [0, 1, 6])
def test_results_come_in_the_order_of_the_items(threads, ahead, count):
    with ThreadPoolExecutor(threads) as pool:
        assert list(prefetch(pool, square, iter(range(count)), ahead=ahead)) == [k * k for k in range(count)]


@pytest.mark.parametrize("ahead", [0, 1, 4])
def test_no_more_are_asked_for_than_are_to_be_ahead(ahead):
    asked = []

    def items():
        for k in range(20):
            asked.append(k)
            yield k

    with ThreadPoolExecutor(2) as pool:
        made = prefetch(pool, square, (k for k in items() if k != 7), ahead=ahead)
        assert asked == [*range(ahead + 1)]  # at once, before one is taken
        assert [next(made) for _ in range(3)] == [0, 1, 4]
        assert asked == [*range(ahead + 3)]


def test_what_spoils_an_item_is_told_when_its_turn_comes():
    with ThreadPoolExecutor(2) as pool:
        made = prefetch(pool, square, range(5, 9), ahead=3)
        assert [next(made), next(made)] == [25, 36]
        with pytest.raises(ValueError, match="item 7 is damaged"):
            next(made)


@pytest.mark.parametrize("taken", [0, 1])
def test_what_has_not_begun_when_no_more_are_taken_is_never_made(taken):
    begun, go = [], Event()

    def slow(k: int) -> int:
        begun.append(k)
        if k:
            go.wait()
        return k

    with ThreadPoolExecutor(1) as pool:
        made = prefetch(pool, slow, range(9), ahead=4)
        try:
            assert [next(made) for _ in range(taken)] == [0] * taken
            made.close()
        finally:
            go.set()  # or the pool would wait for ever
    assert {*begun} <= {0, 1}
