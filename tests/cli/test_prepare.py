"""Errors of `jaxsim prepare`; what it makes is tested in tests/data/test_prepare_command.py."""

import pytest

from jaxsim.cli import main


@pytest.mark.parametrize(
    ("words", "message"),
    [((), "no data set was named"), (("prepared",), "name the data set of its frames")],
)
def test_only_the_data_set_of_frames_can_be_prepared(tmp_path, words, message):
    with pytest.raises(SystemExit, match=message):
        main(["prepare", *words, "--out", str(tmp_path)])
