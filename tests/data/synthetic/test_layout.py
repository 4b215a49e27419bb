"""Streets as they are laid out."""

from functools import cache

import numpy as np
import pytest

from jaxsim.data.synthetic import SyntheticWorld
from jaxsim.data.synthetic.layout import STATISTICS, Drive, lay_out
from jaxsim.data.synthetic.solids import CAPACITY


@cache
def drive(number: int, streets: str) -> Drive:
    return lay_out(3, number, streets)


@pytest.mark.parametrize("streets", STATISTICS)
def test_streets_fit_into_the_room_for_solids(streets) -> None:
    counts = np.array([drive(number, streets).parts.counts for number in range(12)])
    assert (counts.max(axis=0) < 0.9 * np.array(CAPACITY)).all()


@pytest.mark.long
def test_less_parks_and_more_drives_in_the_suburb() -> None:
    """Numbers in 20 streets; parked cars stand still."""
    things = {name: [t for d in range(20) for t in drive(d, name).things if t.kind] for name in ("town", "suburb")}
    parked = {name: sum(t.kind == "Car" and t.speed_mps == 0 for t in all_of) for name, all_of in things.items()}
    trucks = {name: sum(t.kind == "Truck" and t.speed_mps != 0 for t in all_of) for name, all_of in things.items()}
    assert parked["suburb"] < 0.7 * parked["town"]
    assert trucks["suburb"] > 1.2 * trucks["town"]
    with pytest.raises(ValueError, match="no streets 'village'; there are town, suburb"):
        SyntheticWorld(streets="village")
