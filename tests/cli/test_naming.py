"""Flags of naming, and those that do not go with different streets."""

from pathlib import Path

import pytest

from jaxsim.cli.discover import Discover
from jaxsim.cli.naming import NOT_UNPAIRED, Naming, check_unpaired
from jaxsim.discover import NO_CONTROL
from jaxsim.effects.chain import SensorModel

PLAIN = vars(Discover(out=Path("out"), unpaired=True))


def test_every_flag_that_asks_of_the_same_streets_is_refused_by_its_name():
    check_unpaired(PLAIN)
    check_unpaired({**dict.fromkeys(NOT_UNPAIRED, 1), "unpaired": False})
    assert {*NOT_UNPAIRED} <= {*PLAIN}
    for flag in NOT_UNPAIRED:
        name = "a run" if flag == "run" else f"--{flag.replace('_', '-')}"
        with pytest.raises(ValueError, match=f"discover: {name} came with --unpaired"):
            check_unpaired(PLAIN | {flag: 1})


def test_nothing_is_in_place_where_nothing_is_given():
    assert Naming(out=Path("out")).in_place() == {"known": SensorModel(), "control": NO_CONTROL}
