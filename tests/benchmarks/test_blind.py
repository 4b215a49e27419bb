"""The benchmark of hidden effects: its plan, its files, its tables, and a slice of it from case to picture."""

import json
from dataclasses import asdict

import pytest

from benchmarks.blind import where
from benchmarks.blind.case import run_case
from benchmarks.blind.effects import failed, main
from benchmarks.blind.hidden import list_effects, list_outside
from benchmarks.blind.pictures import save_pictures
from benchmarks.blind.plan import DEVELOPMENT, Counts, Job, Settings, plan
from benchmarks.blind.rivals import RIVALS, best_covariate, judge_rival
from benchmarks.blind.rows import append_row, check_settings, read_rows, run_cases
from benchmarks.blind.tables import closures, summary, wilson
from jaxsim.discover.rules import RULES
from tests.discover.few_rays import looking_at

pytestmark = pytest.mark.long

SMALL = Settings(scenes=12, rows=24, columns=192)
CANDIDATES = ("beam_gain", "range_falloff", "random_dropout", "range_walk")
SLICE = (Job("beam_gain", 4.0, "default", 0), Job("none", 1.0, "exact", 0))
WALK, OUTSIDE = Job("range_walk", 8.0, "default", 0), Job("outside:azimuth_periodic_drop", 8.0, "default", 0)


@pytest.fixture(scope="module")
def slice_rows(tmp_path_factory, standard_promotion):
    folder = tmp_path_factory.mktemp("slice")
    with looking_at(1 / 2):
        return {job.effect: run_case(job, SMALL, folder, effects=CANDIDATES) for job in SLICE}


def check_complete(row):
    """Holds that a row keeps how certain each name was, and what rivals answer from the same fits."""
    assert list(row["p_values"]) == list(row["gains"]) == row["answer"]
    assert all(0 < p <= RULES.agreement_level for p in row["p_values"].values())
    assert row["rivals"]["always none"] == []
    assert {name for names in row["rivals"].values() for name in names} <= set(list_effects())


def test_the_slice_names_what_is_hidden_and_nothing_else(slice_rows):
    assert slice_rows["beam_gain"]["right"]
    assert slice_rows["none"]["right"]


@pytest.mark.slow
def test_what_walks_is_in_the_set_and_what_no_effect_describes_has_no_name(tmp_path, standard_promotion):
    walk = run_case(WALK, SMALL, tmp_path, effects=CANDIDATES)
    outside = run_case(OUTSIDE, SMALL, tmp_path, effects=CANDIDATES)
    assert walk["in_set"]
    assert not outside["false_names"]
    check_complete(walk)
    check_complete(outside)


def test_rows_keep_how_certain_each_name_was_and_what_rivals_answer(slice_rows):
    for row in slice_rows.values():
        check_complete(row)
    assert slice_rows["beam_gain"]["rivals"]["held-out likelihood"] == ["beam_gain"]


def test_the_true_effect_shrinks_the_gap_as_the_named_one_does(slice_rows):
    reached, placebo = closures(slice_rows["beam_gain"])
    assert reached == pytest.approx(1, abs=0.15)
    assert placebo < 0.5
    assert slice_rows["none"]["known"] is None


def test_the_slice_becomes_tables_and_pictures(slice_rows, tmp_path):
    rows = json.loads(json.dumps(list(slice_rows.values())))
    text = summary(rows)
    assert "2 development cases" in text
    assert "| severity 4: right name first |" in text
    assert "| exact nulls: an effect named | 0 % (0 of 1; 0 to 79 %) |" in text
    save_pictures(tmp_path, rows)
    assert {path.name for path in tmp_path.glob("*.svg")} == {"confusion.svg", "power.svg"}


@pytest.mark.parametrize("sealed", [False, True])
def test_seeds_stay_when_counts_grow(sealed):
    few = {job.key: job.seed(sealed=sealed) for job in plan(Counts((2.0,), 1, 3, 1, 4), sealed=sealed)}
    more = {job.key: job.seed(sealed=sealed) for job in plan(Counts((1.0, 2.0), 2, 9, 2, 8), sealed=sealed)}
    assert len(few) == len(list_effects()) + 6 + len(list_outside()) + 8
    assert few.items() <= more.items()
    assert all((seed >= DEVELOPMENT) == sealed for seed in more.values())


def test_a_later_run_asks_what_no_earlier_one_has():
    kinds = {"repeats": 1, "nulls": 4, "outside": 2, "pairs": 3}
    all_of = {
        job.key for job in plan(Counts((2.0,), **{kind: 2 * count for kind, count in kinds.items()}), sealed=True)
    }
    for kind, count in kinds.items():
        nothing = dict.fromkeys(kinds, 0)
        earlier = {job.key for job in plan(Counts((2.0,), **nothing | {kind: count}), sealed=True)}
        later = {job.key for job in plan(Counts((2.0,), **nothing | {kind: count}, first=count), sealed=True)}
        assert len(later) == len(earlier) > 0
        assert not later & earlier
        assert later < all_of


def test_cases_lie_in_folders_of_their_own_that_tell_nothing():
    jobs = plan(Counts(), sealed=True)
    assert len({job.key for job in jobs}) == len(jobs) == len({job.place(sealed=True) for job in jobs})


def test_a_half_written_row_is_cut_off_and_the_last_row_of_a_case_counts(tmp_path):
    path = tmp_path / "cases.jsonl"
    for verdict in ("error", "none"):
        append_row(path, {"key": "a", "verdict": verdict})
    with path.open("a") as file:
        file.write('{"key": "b", "verd')
    assert read_rows(path) == [{"key": "a", "verdict": "none"}]
    append_row(path, {"key": "c"})
    assert [row["key"] for row in read_rows(path)] == ["a", "c"]
    path.write_text("no row\n")
    with pytest.raises(ValueError, match="line 1 is no row"):
        read_rows(path)


def test_only_cases_that_are_missing_are_answered_and_the_table_is_of_all(tmp_path, capsys):
    asked = []

    def case(key):
        return lambda: asked.append(key) or {"key": key, "settings": {}}

    cases = {key: case(key) for key in "abc"}
    for most in (2, None):
        run_cases(tmp_path, cases, summary=lambda rows: f"{len(rows)} rows", most=most)
    assert asked == ["a", "b", "c"]
    assert (tmp_path / "summary.md").read_text() == "3 rows\n"
    assert capsys.readouterr().out == "2 rows\n3 rows\n"
    with pytest.raises(ValueError, match="sealed False"):
        run_cases(tmp_path, cases, summary=str, settings={"sealed": True})


def test_cases_of_other_settings_are_not_mixed():
    row = {"settings": asdict(SMALL)}
    check_settings([row], asdict(SMALL))
    with pytest.raises(ValueError, match=r"sealed False \(now True\)"):
        check_settings([row], asdict(Settings(True, 12, 24, 192)))
    with pytest.raises(ValueError, match=r"drawn 0 \(now 20\)"):
        check_settings([{"settings": {"sealed": False}}], asdict(Settings(drawn=20)))


def _row(**more):
    row = failed(Job("range_falloff", 2.0, "default", 0), SMALL, ValueError("none"))
    rivals = {name: [] for name in RIVALS} | {"held-out likelihood": ["beam_gain"]}
    return row | {"verdict": "named", "rivals": rivals, "oracle": 1.0} | more


def test_rates_are_counted_by_kind():
    right = {"first_right": True, "in_set": True, "right": True, "answer": ["range_falloff"], "set_size": 1.0}
    rows = [_row(**right), _row(key="b", answer=["beam_gain"], set_size=2.0), _row(key="c", truth=["oren_nayar"])]
    text = summary(rows)
    assert "| severity 2: right name first | 33 % (1 of 3; 6 to 79 %) |" in text
    assert "| separable effects, severity >= 2: right name first | 50 % (1 of 2; 9 to 91 %) |" in text
    assert "| mean size of the set | 1.50 |" in text
    assert "| range_falloff | 1 / 1 of 2 |" in text
    assert "| oren_nayar* | 0 / 0 of 1 |" in text


def test_nulls_drawn_from_cases_are_counted_together():
    def drawn(gains, free, bar):
        answered = sum(max(pair) > 0.9 for pair in zip(gains, free, strict=True))
        return {"gains": gains, "free": free, "answered": answered, "bar": bar, "free_bar": 0.9}

    rows = [_row(drawn=drawn([0.2, 1.4], [0.0, 0.0], 1.4)), _row(key="b", drawn=drawn([0.1, 0.0], [0.3, 0.0], 0.9))]
    text = summary(rows)
    assert "On 25 % (1 of 4; 5 to 70 %) of the nulls drawn from the cases, 2 from each" in text
    assert "raise it for effects in 1 and for free curves in 0 of 2 cases; the highest bars are 1.4 and 0.9" in text
    assert "drawn from the cases" not in summary([_row()])


def test_wilson_covers_what_no_case_has_shown():
    assert wilson(0, 100) == pytest.approx((0, 0.037), abs=1e-3)
    assert wilson(0, 0) == (0, 1)


def test_rows_of_two_versions_of_the_code_are_said_to_be_no_measurement():
    assert "not one measurement" in summary([_row(), _row(key="b", code="old")])


def test_an_error_counts_as_wrong():
    row = failed(Job("beam_gain+fog_backscatter", 2.0, "default", 0), SMALL, ValueError("bad"))
    assert (row["kind"], row["right"], row["f1"]) == ("combination", False, 0.0)
    assert "counted as wrong (1): beam_gain+fog_backscatter 2 default 0" in summary([row])


def test_a_rival_is_right_with_nothing_for_nothing_and_never_outside():
    null, pair = {"kind": "none", "truth": []}, {"kind": "combination", "truth": ["a", "b"]}
    assert judge_rival(null, [])["right"]
    assert not judge_rival(null, ["a"])["right"]
    assert judge_rival({"kind": "single", "truth": ["a"]}, ["a"])["right"]
    assert judge_rival(pair, ["a"]) == {"named": True, "right": False, "f1": pytest.approx(2 / 3)}
    assert judge_rival({"kind": "outside", "truth": ["outside:x"]}, [])["right"] is False


def test_the_best_covariate_stands_for_the_most_specific_effect():
    assert best_covariate([{"channel": "intensity", "covariate": "row"}]) == ["beam_gain"]
    assert best_covariate([{"channel": "drop", "covariate": "hue"}]) == []
    assert best_covariate([]) == []


def test_closure_is_held_against_the_truth_in_the_channels_that_it_changes():
    known = {"intensity": [50.0, 45.0, 0.0], "range": [3.0, 0.0, 0.0]}
    answer = {"intensity": [45.0, 45.0, 10.0], "range": [-90.0, 0.0, 0.0]}
    row = {"truth": ["beam_gain"]}
    assert closures(row | {"gained": answer, "known": {"gained": known}}) == pytest.approx((0.9, 0.2))
    little = {name: [0.5, 0.0, 0.0] for name in known}
    assert closures(row | {"gained": answer, "known": {"gained": little}}) is None


def test_the_command_shows_what_is_there_without_computing(tmp_path, capsys):
    append_row(tmp_path / "cases.jsonl", _row())
    with pytest.raises(ValueError, match="rows 24"):
        main([str(tmp_path), "--table", "--scenes", "12"])
    append_row(tmp_path / "cases.jsonl", _row(settings=asdict(Settings())))
    main([str(tmp_path), "--table"])
    assert "1 development cases" in capsys.readouterr().out
    assert (tmp_path / "summary.md").is_file()


def test_where_is_asked_of_the_same_cases_and_scored_by_the_key(tmp_path, standard_promotion):
    rows = [where._answer(job, SMALL, tmp_path / "case") for job in SLICE]
    assert [row["where_right"] for row in rows] == [True, None]
    assert not any(tmp_path.iterdir())
    lines = where.summary(rows).splitlines()
    assert "| one effect, severity 4 | 100 % (1 of 1; 21 to 100 %) | 100 % (1 of 1; 21 to 100 %) |" in lines
    assert any(line.startswith("| beam_gain | 4 | intensity on row") for line in lines)
