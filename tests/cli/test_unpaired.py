"""Flags that ask of the same streets what --unpaired has of different ones."""

from pathlib import Path

import pytest

from jaxsim.cli.discover import Discover
from jaxsim.cli.unpaired import NOT_UNPAIRED, check_unpaired

PLAIN = vars(Discover(out=Path("out"), unpaired=True))


def test_every_flag_is_one_of_the_command_and_is_refused_by_its_name():
    check_unpaired(PLAIN)
    check_unpaired({**dict.fromkeys(NOT_UNPAIRED, 1), "unpaired": False})
    assert {*NOT_UNPAIRED} <= {*PLAIN}
    for flag in NOT_UNPAIRED:
        name = "a run" if flag == "run" else f"--{flag.replace('_', '-')}"
        with pytest.raises(ValueError, match=f"discover: {name} came with --unpaired"):
            check_unpaired(PLAIN | {flag: 1})
