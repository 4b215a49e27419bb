import random

import pytest
from beartype.roar import BeartypeCallHintParamViolation

from tests.typechecker import check


@check
def total(values: list[float]) -> float:
    return sum(values)


def test_a_check_of_a_lists_items_leaves_pythons_random_state_as_it_was():
    before = random.getstate()
    assert total([1, 2.5, 3]) == 6.5
    assert random.getstate() == before


def test_an_item_of_another_type_is_refused():
    with pytest.raises(BeartypeCallHintParamViolation):
        total(["1", "2"])
