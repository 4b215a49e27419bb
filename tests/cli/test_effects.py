import pytest

from jaxsim.cli import main
from jaxsim.effects import EFFECTS
from tests.effects.own import forgetful, write  # noqa: F401  (a fixture)

pytestmark = pytest.mark.usefixtures("forgetful")


def test_the_table_lists_every_effect_and_a_name_tells_one(capsys):
    main(["effects"])
    listed = capsys.readouterr().out
    assert all(name in listed for name in EFFECTS)
    main(["effects", "beam_gain"])
    assert EFFECTS["beam_gain"].title in capsys.readouterr().out


def test_an_unknown_effect_answers_with_the_known_ones():
    with pytest.raises(SystemExit, match="range_falloff"):
        main(["effects", "beam_gan"])
