"""`jaxsim engines`."""

import json

import pytest

from jaxsim.cli import main


def test_the_command_says_it_in_words_and_in_the_engines_format(answer, tmp_path, capsys):
    main(["engines", str(answer), "--for", "carla", "--out", str(tmp_path / "carla.json")])
    printed = capsys.readouterr().out
    assert "| `atmosphere_attenuation_rate` | 0.01 | 0.008 .. 0.012 | 1/m |" in printed
    assert "- `incidence_cosine`: its intensity is exp(-rate" in printed
    assert "not given" in printed
    assert json.loads((tmp_path / "carla.json").read_text())["blueprint"] == "sensor.lidar.ray_cast"
    assert (tmp_path / "carla.md").read_text() in printed


def test_of_a_number_a_beam_the_table_tells_the_span(answer, capsys):
    """Not their mean, of which nobody can set anything."""
    main(["engines", str(answer), "--for", "isaac"])
    printed = capsys.readouterr().out
    assert "distanceCorrectionM` | -0.02 to 0.01, of 2 beams | of each in verdict.json | m |" in printed


def test_the_answer_is_not_written_over(tmp_path, answer):
    """Its own name given as --out made of sensor.json a file of CARLA's, and of now.json, too."""
    before = answer.read_text()
    (tmp_path / "now.json").write_text("{}")
    (tmp_path / "link.json").symlink_to(answer)
    for out in (answer, answer.with_name("verdict.json"), tmp_path / "now.json", tmp_path / "link.json"):
        with pytest.raises(SystemExit, match="is read, and would be written over; give another --out"):
            main(["engines", str(answer), "--out", str(out), "--now", str(tmp_path / "now.json")])
    assert answer.read_text() == before
    assert (tmp_path / "now.json").read_text() == "{}"


def test_a_page_of_the_users_own_is_not_written_over(tmp_path, answer):
    (tmp_path / "README.md").write_text("# Ours\n")
    with pytest.raises(SystemExit, match=r"README\.md, where the words would go, is no page of this command"):
        main(["engines", str(answer), "--for", "carla", "--out", str(tmp_path / "README.json")])
    assert (tmp_path / "README.md").read_text() == "# Ours\n"
    # One of its own is made anew.
    for _ in range(2):
        main(["engines", str(answer), "--for", "carla", "--out", str(tmp_path / "carla.json")])
    assert (tmp_path / "carla.md").read_text().startswith("# CARLA")


def test_what_is_no_answer_is_refused(tmp_path, answer, capsys):
    with pytest.raises(SystemExit, match=r"no file .*nothing\.json"):
        main(["engines", str(tmp_path / "nothing.json"), "--for", "rgl"])
    (tmp_path / "now.json").write_text('{"noise_stddev": "much"}')
    with pytest.raises(SystemExit, match="must be an object of numbers"):
        main(["engines", str(answer), "--for", "carla", "--now", str(tmp_path / "now.json")])
    with pytest.raises(SystemExit, match=r"is where the words go, .*; give .*gap\.usda"):
        main(["engines", str(answer), "--for", "isaac", "--out", str(tmp_path / "gap.md")])
    (answer.parent / "verdict.json").write_text("[]")
    with pytest.raises(SystemExit, match="is not what `jaxsim discover` writes"):
        main(["engines", str(answer), "--for", "carla"])
