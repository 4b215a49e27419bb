"""The catalogue in words: on the page and on the command line."""

from pathlib import Path

import pytest

from jaxsim.cli import main
from jaxsim.effects import EFFECTS
from jaxsim.effects.page import effects_table, page

DOCS = Path(__file__).parents[2] / "docs"


def test_the_page_is_that_of_the_code():
    made = "run `python -m jaxsim.effects.page > docs/effects.md`"
    assert (DOCS / "effects.md").read_text() == page(), made


def test_the_list_has_a_line_for_each_effect(capsys):
    main(["effects"])
    printed = capsys.readouterr().out
    assert printed.strip() == effects_table()
    assert [line.split()[0] for line in printed.splitlines()[1:]] == list(EFFECTS)


@pytest.mark.parametrize("name", ["beam_gain", "packet_loss"])
def test_an_effect_is_told_whole(capsys, name):
    main(["effects", name])
    printed = capsys.readouterr().out
    effect = EFFECTS[name]
    for text in (effect.formula, effect.signature, effect.source, *effect.parameters, *effect.look_alikes):
        assert text in printed


def test_an_unknown_name_is_answered_with_the_known_ones(capsys):
    with pytest.raises(SystemExit, match=r"did you mean beam_gain\? One of your own needs --effects-from"):
        main(["effects", "beam_gian"])
    with pytest.raises(
        SystemExit, match=r"no effect named 'gain'; did you mean beam_gain\? .* Known: extrinsic_rotation"
    ):
        main(["effects", "gain"])
