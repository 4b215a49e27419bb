"""Linear algebra stays off the cores that compiled programs use."""

import inspect

import pytest
from threadpoolctl import threadpool_info

from jaxsim.devices import one_blas_thread
from jaxsim.discover import disagreements, discover, discover_unpaired
from jaxsim.discover.workflow import judge_known


def threads() -> list[int]:
    return [pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"]


def test_blas_has_one_thread_inside_and_as_many_as_before_after_an_error():
    before, inside = threads(), []

    @one_blas_thread
    def solve():
        inside.extend(threads())
        raise ArithmeticError

    with pytest.raises(ArithmeticError):
        solve()
    assert before, "NumPy without a BLAS that threadpoolctl knows"
    assert set(inside) == {1}
    assert threads() == before


@pytest.mark.parametrize("entry", [discover, discover_unpaired, disagreements, judge_known])
def test_every_entry_to_discovery_is_held_to_one_thread_and_keeps_its_signature(entry):
    assert entry.__wrapped__.__name__ == entry.__name__
    assert inspect.signature(entry).return_annotation is not inspect.Signature.empty
