"""The benchmark of three worlds: its cells, its plan, its rows and its table; every world's folders are readable."""

import json
from dataclasses import asdict

import numpy as np
import pytest

from benchmarks.blind import rows, worlds
from benchmarks.blind.effects import failed
from benchmarks.blind.hidden import key_path, list_effects
from benchmarks.blind.making import make
from benchmarks.blind.plan import DEVELOPMENT, Job, Settings
from benchmarks.blind.rows import read_rows
from jaxsim.discover import read_comparison

HOME, NOISY = Settings(), Settings(simulator="noisy")
JOB = Job("beam_gain", 4.0, "default", 0)


def _answered(job, settings, **more):
    """A right answer's row."""
    row = failed(job, settings, ValueError("no"))
    named = bool(row["truth"])
    right = dict.fromkeys(("first_right", "in_set", "exact"), True) if named else {"exact": True}
    answer = {"verdict": "named" if named else "none", "answer": row["truth"], "named": named, "right": True}
    return row | answer | right | {"false_names": []} | more


def test_every_cell_has_the_same_jobs_and_more_cases_keep_the_first():
    few = worlds.plan_cells([HOME, NOISY], (1.0, 2.0, 4.0), cases=range(4), nulls=range(3))
    many = worlds.plan_cells([HOME, NOISY], (1.0, 2.0, 4.0), cases=range(45), nulls=range(8))
    assert {worlds.key_of(*task) for task in few} < {worlds.key_of(*task) for task in many}
    jobs = {settings.cell: [job for job, s in many if s == settings] for settings in (HOME, NOISY)}
    assert len(jobs) == 2
    assert jobs[HOME.cell] == jobs[NOISY.cell]
    planted = {(job.effect, job.severity) for job in jobs[HOME.cell] if job.effect != "none"}
    assert planted == {(effect, severity) for effect in worlds.HIDDEN for severity in (1.0, 2.0, 4.0)}
    assert len({worlds.key_of(*task) for task in many}) == len(many)


def test_a_job_hides_the_same_seed_in_every_cell_and_cells_share_no_folder():
    assert JOB.seed(sealed=False) < DEVELOPMENT <= JOB.seed(sealed=True)
    assert len({s.cell for s in (HOME, NOISY, Settings(given="bare"), Settings(world="raycast", sensor="spin16"))}) == 4


def test_the_rendered_world_skips_what_it_cannot_hide():
    rendered = Settings(world="mitsuba", sensor="turn")
    tasks = worlds.plan_cells([HOME, rendered], (2.0,), cases=range(15), nulls=range(0))
    hidden = {world: {job.effect for job, s in tasks if s.world == world} for world in ("home", "mitsuba")}
    assert hidden["home"] - hidden["mitsuba"] == {"range_quantization"}
    mitsuba = pytest.importorskip("benchmarks.blind.mitsuba", reason="pip install -e '.[worlds]'", exc_type=ImportError)
    assert hidden["mitsuba"] <= {*mitsuba.EFFECTS}
    assert {*worlds.SENSORS["mitsuba"]} == {*mitsuba.SENSORS}


def test_each_world_takes_the_sensors_that_it_knows_and_is_refused_without(tmp_path):
    named = ["--world", "home", "raycast", "mitsuba", "--simulator", "noisy"]
    found = worlds.cells(worlds.arguments([str(tmp_path), *named, "--sensor", "raster", "front"]))
    assert [s.cell for s in found] == ["home-own-noisy-all", "raycast-raster-noisy-all", "mitsuba-front-noisy-all"]
    assert [(s.rows, s.columns) for s in found] == [(48, 384), (0, 0), (48, 384)]
    with pytest.raises(ValueError, match="mitsuba has none of these sensors; --sensor turn or front or coarse"):
        worlds.cells(worlds.arguments([str(tmp_path), *named, "--sensor", "raster"]))


def test_the_effects_are_those_that_the_first_worlds_hide():
    assert {*worlds.HIDDEN} <= {*list_effects()}
    raycast = pytest.importorskip("benchmarks.blind.raycast", reason="pip install -e '.[worlds]'", exc_type=ImportError)
    assert {*worlds.HIDDEN} == {*raycast.EFFECTS}
    assert {*worlds.SENSORS["raycast"]} == {*raycast.SENSORS}
    assert {*raycast.SIMULATORS} == {*worlds.SIMULATORS}


@pytest.mark.parametrize("given", ["all", "bare"])
@pytest.mark.parametrize("world", ["home", "raycast", "mitsuba"])
def test_discover_can_read_every_world(tmp_path, world, given):
    if world in worlds.NEEDS:
        pytest.importorskip(worlds.NEEDS[world], reason="pip install -e '.[worlds]'")
    settings = Settings(False, 2, 8, 60, simulator="noisy", world=world, sensor=worlds.SENSORS[world][0], given=given)
    make(JOB, settings, tmp_path / "case")
    read = read_comparison(tmp_path / "case" / "simulated", tmp_path / "case" / "measured")
    assert read.scan.range_m.shape == (2, 8, 60)
    assert len(set(read.scenes)) == 2
    assert bool(np.asarray(read.scan.semantic).any()) == (given == "all")
    assert bool(np.asarray(read.scan.speed_mps).any()) == (given == "all")
    key = json.loads(key_path(tmp_path / "case").read_text())
    assert (key["level"] if world == "mitsuba" else key["simulator"]["name"]) == "noisy"


def test_an_unknown_world_is_refused(tmp_path):
    with pytest.raises(ValueError, match="choose home, raycast or mitsuba"):
        make(JOB, Settings(world="mars"), tmp_path / "case")


def test_a_run_goes_on_where_it_stopped_and_tries_errors_again(tmp_path, monkeypatch, capsys):
    asked = []

    def answers(tasks, out, *, workers):
        for number, (job, settings) in enumerate(tasks):
            asked.append(worlds.key_of(job, settings))
            first = len(asked) == 1 and number == 0
            yield failed(job, settings, ValueError("once")) if first else _answered(job, settings)

    monkeypatch.setattr(worlds, "answers", answers)
    command = [str(tmp_path), "--world", "home", "--simulator", "ideal", "noisy", "--cases", "1", "--nulls", "1"]
    worlds.main([*command, "--most", "2"])
    assert len(asked) == 2
    worlds.main(command)
    assert len(asked) == 5
    assert len(set(asked)) == 4
    assert len(read_rows(tmp_path / "cases.jsonl")) == 4
    worlds.main([*command, "--table"])
    assert len(asked) == 5
    assert (
        "| home | own | noisy | all | 0 % (0 of 1; 0 to 79 %) | 100 % (1 of 1; 21 to 100 %) |"
        in capsys.readouterr().out
    )
    with pytest.raises(ValueError, match="scenes 16 \\(now 3\\)"):
        worlds.main([*command, "--scenes", "3"])


@pytest.mark.parametrize("world", ["raycast", "mitsuba"])
def test_without_its_library_a_later_world_is_refused_before_anything_runs(tmp_path, monkeypatch, world):
    monkeypatch.setattr(worlds, "find_spec", lambda name: None)
    with pytest.raises(ValueError, match=f"{world} needs {worlds.NEEDS[world]}, .*pip install -e"):
        worlds.main([str(tmp_path), "--world", world, "--cases", "1", "--nulls", "0"])
    assert not (tmp_path / "cases.jsonl").exists()


def test_the_table_tells_false_names_from_missed_ones():
    missed = failed(JOB, HOME, ValueError("no")) | {"verdict": "none", "false_names": []}
    wrong = _answered(Job("range_scale", 1.0, "default", 0), HOME, false_names=["range_walk"], exact=False)
    null = _answered(Job("none", 1.0, "exact", 0), HOME) | {"named": True, "answer": ["gamma_response"], "right": False}
    rows = [row | {"key": f"{HOME.cell} {row['key']}", "settings": asdict(HOME)} for row in (missed, wrong, null)]
    text = worlds.summary(rows)
    assert "100 % (1 of 1; 21 to 100 %) | 50 % (1 of 2; 9 to 91 %) | 50 % (1 of 2; 9 to 91 %) | 50 % (1 of 2;" in text
    assert f"| {HOME.cell} | nothing, exact | 1 | - | gamma_response |" in text
    assert f"| {HOME.cell} | beam_gain | 4 | - | none |" in text
    assert worlds.summary([]) == "no case yet"


def test_cells_are_told_together_by_what_they_differ_in_and_an_oracle_beside_nulls_enough():
    bare = Settings(given="bare")
    nulls = [(Job("none", 1.0, "exact", k), HOME) for k in range(20)]
    rows = []
    for job, settings in [*nulls, (JOB, HOME), (JOB, bare)]:
        row = _answered(job, settings, ranking=[["beam_gain", 9.0 if job is JOB else 0.1], ["blooming", 0.0]])
        rows.append(row | {"key": worlds.key_of(job, settings), "settings": asdict(settings)})
    text = worlds.summary(rows)
    every, one = (
        "| home | own | ideal | every | 0 % (0 of 20; 0 to 16 %) | 100 % (2 of 2;",
        "100 % (1 of 1; 21 to 100 %)",
    )
    assert text.count(every) == 1
    assert f"| {HOME.cell} | {one} | {one} | {one} | {one} | {one} | - |" in text
    assert "oracle" not in worlds.summary(rows[1:])


def test_later_numbers_of_the_plan_are_cases_that_the_first_do_not_hold():
    first = worlds.plan_cells([HOME], (2.0,), cases=range(30), nulls=range(0))
    later = worlds.plan_cells([HOME], (2.0,), cases=range(30, 60), nulls=range(0))
    seeds = [{job.seed(sealed=True) for job, _ in tasks} for tasks in (first, later)]
    assert [len(found) for found in seeds] == [30, 30]
    assert not seeds[0] & seeds[1]


def test_rows_know_the_code_by_its_sources_and_not_by_what_was_measured(tmp_path, monkeypatch):
    for name in ("effects.py", "hidden/units.json", "measured/worlds/cases/one.key.json"):
        (tmp_path / "benchmarks/blind" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "benchmarks/blind" / name).write_text("1")
    monkeypatch.setattr(rows, "ROOT", tmp_path)
    monkeypatch.setattr(rows, "MEASURED", tmp_path / "benchmarks/blind/measured")
    version = rows.code_version.__wrapped__
    before = version()
    (tmp_path / "benchmarks/blind/measured/worlds/cases/two.key.json").write_text("2")
    assert version() == before
    (tmp_path / "benchmarks/blind/hidden/units.json").write_text("2")
    assert version() != before
