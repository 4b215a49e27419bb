"""`jaxsim effects`, and effects of one's own: `new` and `check`."""

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


@pytest.mark.long
def test_the_file_that_new_writes_passes_check_and_is_listed(tmp_path, capsys):
    path = tmp_path / "rain_on_lens.py"
    main(["effects", "new", "rain_on_lens", "--out", str(path)])
    main(["effects", "check", str(path)])
    printed = capsys.readouterr().out
    for words in ("4 ln cos(elevation)", "share of the natural fall-off", "beam_gain (", "all checks passed"):
        assert words in printed
    assert "rain_on_lens" not in EFFECTS
    main(["effects", "--effects-from", str(path)])
    assert "rain_on_lens" in capsys.readouterr().out
    main(["effects", "rain_on_lens", "--effects-from", str(path)])
    assert "SHA-256" in capsys.readouterr().out


def test_check_tells_in_one_line_what_is_wrong(tmp_path):
    path = write(tmp_path, channels='("range",)')
    with pytest.raises(
        SystemExit, match=r"error: effects: .*vignetting.py: vignetting: apply changes the channel inten"
    ):
        main(["effects", "check", str(path)])


@pytest.mark.parametrize("command", ["discover --measured m --simulated s", "simulate r"])
def test_a_file_that_is_none_stops_discover_and_simulate_first(tmp_path, monkeypatch, command):
    monkeypatch.setattr("jaxsim.cli.simulate.load", lambda run: pytest.fail("read the run first"))
    with pytest.raises(SystemExit, match=r"no Python file a\.txt; --effects-from takes"):
        main([*command.split(), "--out", str(tmp_path / "out"), "--effects-from", "a.txt"])


def test_own_effects_do_not_go_with_unpaired(tmp_path):
    given = ["--measured", "m", "--simulated", "s", "--out", str(tmp_path), "--unpaired", "--effects-from", "a.py"]
    with pytest.raises(SystemExit, match="--effects-from came with --unpaired, which tells effects of the catalogue"):
        main(["discover", *given])


@pytest.mark.parametrize("command", ["discover", "simulate", "effects", "export", "effects check"])
def test_the_help_says_that_the_file_is_run(command, capsys):
    with pytest.raises(SystemExit):
        main([*command.split(), "--help"])
    said = " ".join(capsys.readouterr().out.replace("│", " ").split())
    assert "Its code is run: give only files that you have read" in said
