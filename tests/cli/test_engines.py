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
