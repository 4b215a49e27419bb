"""`jaxsim eval`, of which eval.py is another name: the first word says what is scored."""

import pytest

from jaxsim.cli import MODES, main


@pytest.mark.parametrize("mode", MODES)
def test_a_mode_parses_its_own_flags(mode: str):
    with pytest.raises(SystemExit) as stop:
        main([*mode.split(), "--no-such-flag"])
    assert stop.value.code == 2


def test_any_other_word_is_a_run():
    with pytest.raises(SystemExit, match=r"no config\.json in nowhere"):
        main(["eval", "nowhere"])


def test_a_file_is_no_run(tmp_path):
    (tmp_path / "generator.npz").write_bytes(b"")
    with pytest.raises(SystemExit, match=r"run: no config\.json in .*generator\.npz; `jaxsim train` makes one"):
        main(["eval", str(tmp_path / "generator.npz")])
