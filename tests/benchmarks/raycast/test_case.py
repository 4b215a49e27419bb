"""Cases of the second world: folders that the reader takes, keys that the scorer takes, effects where they belong."""

import ast
import json
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("embreex", reason="the second hidden world casts with embreex: pip install -e '.[worlds]'")

from benchmarks.blind.hidden import key_path, list_effects, score_case
from benchmarks.blind.raycast import EFFECTS, SENSORS, SIMULATORS, case, make_case, optics
from jaxsim.data.polar_frames import open_polar_frames

SMALL = {"scenes": 2, "rows": 8, "columns": 60}


def frames_of(folder: Path, part: str) -> dict[str, np.ndarray]:
    arrays = [np.load(file) for file in sorted((folder / part).glob("*.npz"))]
    return {name: np.stack([a[name] for a in arrays]) for name in arrays[0]}


def test_it_imports_nothing_of_the_package_nor_of_the_first_world():
    for file in Path(case.__file__).parent.glob("*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            names += [node.module] if isinstance(node, ast.ImportFrom) else []
            assert not [n for n in names if n.startswith(("jaxsim", "benchmarks.blind.hidden"))], file


@pytest.mark.parametrize("sensor", SENSORS)
@pytest.mark.parametrize("place", ["hall", "motorway"])
def test_every_sensor_sees_every_place(tmp_path, sensor, place):
    make_case(tmp_path / "a", seed=1, sensor=sensor, place=place, **SMALL)
    measured, simulated = (open_polar_frames(tmp_path / "a" / part) for part in ("measured", "simulated"))
    assert measured.names == simulated.names == ("0000", "0001")
    for name in measured.names:
        (image, _), (predicted, rasters) = measured.read(name), simulated.read(name)
        assert set(rasters) == {"incidence", "semantic", "instance", "rgb", "time"}
        both = np.asarray(image.valid) & np.asarray(predicted.valid)
        assert both.mean() > (0.9 if place == "hall" else 0.3)
        assert abs(np.median(np.asarray(image.range_m)[both] - np.asarray(predicted.range_m)[both])) < 0.3


def test_bare_frames_hold_range_and_intensity_alone(tmp_path):
    make_case(tmp_path / "a", seed=1, given="bare", **SMALL)
    for part in ("measured", "simulated"):
        assert set(frames_of(tmp_path / "a", part)) == {"range", "intensity"}
    about = json.loads((tmp_path / "a" / "simulated" / "grid.json").read_text())["frames"]
    assert {key for frame in about.values() for key in frame} == {"scene"}


def test_the_same_words_give_the_same_case_and_others_another(tmp_path):
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        make_case(tmp_path / name, effect="beam_gain", seed=seed, **SMALL)
    a, b, c = (frames_of(tmp_path / name, "measured")["range"] for name in "abc")
    np.testing.assert_array_equal(a, b)
    assert not np.allclose(a, c)


def test_the_key_lies_beside_the_folder_and_no_file_tells_what_is_hidden(tmp_path):
    for name, effect in (("a", "none"), ("b", "beam_gain")):
        make_case(tmp_path / name, effect=effect, seed=1, **SMALL)
        assert key_path(tmp_path / name).is_file()
    sizes = [
        sorted((f.relative_to(tmp_path / n), f.stat().st_size) for f in (tmp_path / n).rglob("*.npz")) for n in "ab"
    ]
    assert sizes[0] == sizes[1]


def test_the_effects_are_those_of_the_catalogue():
    assert not {*EFFECTS} - {*list_effects()}


@pytest.mark.parametrize("name", EFFECTS)
def test_an_effect_changes_its_own_channels_and_no_other(tmp_path, monkeypatch, name):
    """The same case with the effect at strength 4 and with none of it: the generator's words are held fixed."""
    for module in (case, optics):
        monkeypatch.setattr(module, "stream", _without_effect(module.stream))
    read = {}
    for folder, severity in (("weak", 1e-9), ("strong", 4.0)):
        make_case(tmp_path / folder, effect=name, severity=severity, seed=4, nuisance="exact", **SMALL)
        read[folder] = frames_of(tmp_path / folder, "measured")
    weak, strong = read["weak"], read["strong"]
    both = (weak["range"] > 0) & (strong["range"] > 0)
    changed = {
        "range": not np.allclose(weak["range"][both], strong["range"][both], atol=1e-5),
        "intensity": not np.allclose(weak["intensity"][both], strong["intensity"][both], atol=1e-6),
        "drop": bool(((weak["range"] > 0) != (strong["range"] > 0)).any()),
    }
    assert {channel for channel, there in changed.items() if there} == set(EFFECTS[name].channels)


def _without_effect(stream):
    """The case's words without its severity, so that two severities share scenes and draws."""
    return lambda words, *what: stream(" ".join([*words.split()[:2], *words.split()[3:]]), *what)


def test_a_rightly_named_effect_with_its_true_parameters_scores_as_right(tmp_path):
    for number, name in enumerate(EFFECTS):
        folder = tmp_path / str(number)
        key = make_case(folder, effect=name, severity=2, seed=5, **SMALL | {"scenes": 1})
        truth = key["effects"][0]["parameters"]
        known = {k: np.asarray(v, float) for k, v in truth.items() if None not in np.ravel(v)}
        given = {
            k: {"value": v.tolist(), "low": (v - 1e-9).tolist(), "high": (v + 1e-9).tolist()} for k, v in known.items()
        }
        (folder / "out").mkdir()
        answer = {"verdict": "named", "effects": [{"name": name, "parameters": given}], "where": []}
        (folder / "out" / "verdict.json").write_text(json.dumps(answer))
        scored = score_case(folder)
        assert scored["right"], name
        assert all(p["inside"] == 1 for p in scored["parameters"]), name


def test_noisy_sides_have_their_own_draws_of_the_same_noise(tmp_path):
    key = make_case(tmp_path / "a", seed=6, nuisance="exact", simulator="noisy", scenes=3, rows=16, columns=120)
    simulated, measured = (frames_of(tmp_path / "a", part) for part in ("simulated", "measured"))
    for side in (simulated, measured):
        np.testing.assert_allclose(side["intensity"] * 255, (side["intensity"] * 255).round(), atol=1e-3)
    both = (simulated["range"] > 0) & (measured["range"] > 0)
    apart = (measured["range"] - simulated["range"])[both]
    assert 1.4826 * np.median(np.abs(apart)) == pytest.approx(0.015 * np.sqrt(2), rel=0.15)
    lost = (simulated["range"] == 0) & (measured["range"] > 0)
    assert 0.003 < lost.mean() < 0.03
    assert (key["simulator"]["name"], key["nuisance"]["loss"]) == ("noisy", 0.01)


@pytest.mark.parametrize("name", SIMULATORS)
def test_a_simulator_without_noise_differs_from_the_sensor_by_what_it_does_not_know(tmp_path, name):
    make_case(tmp_path / "a", seed=6, nuisance="exact", simulator=name, **SMALL)
    simulated, measured = (frames_of(tmp_path / "a", part) for part in ("simulated", "measured"))
    both = (simulated["intensity"] > 0.03) & (measured["intensity"] > 0.03)
    apart = np.log(measured["intensity"][both] / simulated["intensity"][both])
    assert 0.05 < np.std(apart) < 0.8


def test_unknown_words_are_refused_and_leave_nothing_behind(tmp_path):
    for word in ("effect", "simulator", "place", "sensor", "given", "nuisance"):
        with pytest.raises(ValueError, match="choose one of"):
            make_case(tmp_path / "a", **{"seed": 1, **SMALL, word: "perfect"})
    with pytest.raises(ValueError, match="severity is 0"):
        make_case(tmp_path / "a", effect="beam_gain", severity=0, seed=1)
    assert not (tmp_path / "a").exists()
    make_case(tmp_path / "a", seed=1, **SMALL)
    with pytest.raises(FileExistsError, match="no case is overwritten"):
        make_case(tmp_path / "a", seed=1, **SMALL)
