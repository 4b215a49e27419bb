"""The loop's tables and page, from scores and clouds that were made up."""

import json
from dataclasses import replace

import numpy as np
import pytest

from jaxsim.effects.chain import SensorModel
from jaxsim.metrics.cloud_checks import REST, count_clouds
from jaxsim.metrics.detection import COLUMNS, DIFFICULTIES, Curve
from jaxsim.studies.real2sim2real.cloud_charts import class_chart, drop_picture, intensity_chart
from jaxsim.studies.real2sim2real.clouds import check_tables, checked_kinds, write_checks
from jaxsim.studies.real2sim2real.epochs_chart import epochs_chart
from jaxsim.studies.real2sim2real.page import write_loop
from jaxsim.studies.real2sim2real.scores import write_score
from jaxsim.studies.real2sim2real.settings import settle_loop
from jaxsim.studies.real2sim2real.tables import answer, loop_tables
from jaxsim.train.experiments import load_loop

CAR = np.array([[10.0, 0.0, -1.0, 4.0, 2.0, 1.5, 0.0]])
AP = {"raw_64": 40.0, "simulated_64": 55.0, "real": 80.0}


def curves(ap: float) -> list[Curve]:
    """All columns at one average precision; nothing is easy."""
    precision = np.concatenate([[0], np.full(40, ap / 100)])
    return [
        Curve("Car", level, overlap, metric, 0.7, precision, np.zeros(0), np.zeros(0), 0 if level == "easy" else 9, 12)
        for metric, overlap in COLUMNS
        for level in DIFFICULTIES
    ]


def clouds(intensity: float):
    rng = np.random.default_rng(0)
    points = np.column_stack([CAR[0, :3] + rng.uniform(-0.5, 0.5, (90, 3)), np.full(90, intensity)])
    return count_clouds([(points.astype(np.float32), CAR, ("Car",))])


@pytest.fixture
def loop(tmp_path):
    config, _ = load_loop("real2sim2real")
    loop = settle_loop(replace(config, out=tmp_path / "loop", kinds=("raw_64", "simulated_64"), seeds=(0, 1)))
    for seed in loop.config.seeds:
        for trained, judged in loop.judgements:
            steps = range(3)
            write_score(
                loop.score(trained, judged, seed),
                [curves(AP[trained] + 2 * seed) for _ in steps],
                steps=steps,
                frames=5,
            )
    return loop


COUNTS = {"real": 0.4, "raw_64": 0.0, "simulated_64": 0.3}


def test_the_answer_says_what_intensity_was_worth_and_the_spread(loop):
    said = answer(loop)
    assert "56.0 after training on simulated intensity, 41.0 without it (+15.0" in said
    assert "standard deviation over seeds 1.4 and 1.4; over 2 seeds" in said
    one = replace(loop, config=replace(loop.config, seeds=(0,)))
    assert "one seed, so the spread is not known" in answer(one)
    assert answer(replace(loop, config=replace(loop.config, seeds=(7,)))) == "Not all detectors are scored yet."


def test_the_papers_numbers_stand_beside_ours(loop):
    SensorModel((("random_dropout", {"probability": 0.1}),)).save(loop.effects)
    text = loop_tables(loop, {kind: clouds(value) for kind, value in COUNTS.items()})
    assert "found to lack: random_dropout." in text
    assert "| simulated_64 | moderate | 9 | 56.00 ± 1.41 (51.74)" in text
    assert "| raw_64 | easy | - | - (63.78)" in text
    assert "| raw_64 | moderate | 9 | 81.00 ± 1.41 (88.78)" in text  # trained on real, scored on it
    assert "| raw_64 | 1 | 90 |" in text  # one car, 90 points on it; no car at any other distance


def test_the_drop_maps_carry_their_key():
    """Ninety points on one car leave most directions empty: the map's usual colour is the key's right end."""
    picture = drop_picture({"real": clouds(0.4)})
    key, corner = picture[-1], picture[30, 0]
    assert (key[-1] == corner).all()
    assert (key[0] != corner).any()


def test_the_page_stands_alone_and_the_json_is_strict(loop):
    counts = {kind: clouds(value) for kind, value in COUNTS.items()}
    page = write_loop(loop, counts, {"found": np.zeros((8, 8, 3), np.uint8)})
    html = page.read_text()
    assert "http" not in html.replace("http://www.w3.org", "")
    assert html.count("data:image/png") == 6  # a class has a chart
    assert "<b>nan" not in html.lower()

    def refuse(name):
        raise AssertionError(name)

    plain = json.loads((loop.out / "real2sim2real.json").read_text(), parse_constant=refuse)
    moderate = next(r for r in plain["on_real"] if (r["clouds"], r["difficulty"]) == ("simulated_64", "moderate"))
    assert moderate["3D@0.7"]["paper"] == 51.74
    assert moderate["3D@0.7"]["value"] == pytest.approx(56)
    assert plain["clouds"]["raw_64"]["intensity"] == pytest.approx(0.4, abs=0.01)
    drawn = {p.stem for p in (loop.out / "pictures").iterdir()}
    assert drawn == {"found", "drops", "intensity", "on_car", "elsewhere", "epochs"}


def test_each_kind_has_a_line_over_the_checkpoints_and_a_thin_one_a_seed(loop):
    drawn = epochs_chart(loop)
    lines = [s for s in drawn.strokes if hasattr(s, "points") and len(s.points) == 3]
    assert [s.width for s in lines].count(2) == len(COUNTS)
    assert [s.width for s in lines].count(0.5) == 2 * len(COUNTS)
    thick = {s.colour: np.mean(s.points, axis=0)[1] for s in lines if s.width == 2}
    assert len(thick) == len(COUNTS)
    assert (drawn.pixels() < 128).any()
    assert epochs_chart(replace(loop, config=replace(loop.config, seeds=(7,)))) is None


def test_the_chart_draws_a_line_for_each_kind(loop):
    drawn = intensity_chart({kind: clouds(value) for kind, value in COUNTS.items()})
    assert [s.text for s in drawn.strokes if getattr(s, "text", "") in COUNTS] == list(COUNTS)
    assert (drawn.pixels() < 128).any()


def street(*things, intensity=0.5):
    """A scene of objects (class, distance ahead, points on it), and the road."""
    rng = np.random.default_rng(1)
    boxes = np.array([[x, 0.0, -1.0, 4.0, 2.0, 1.5, 0.0] for _, x, _ in things])
    on = [box[:3] + rng.uniform(-0.5, 0.5, (n, 3)) for box, (_, _, n) in zip(boxes, things, strict=True)]
    road = np.column_stack([rng.uniform(25, 28, 50), rng.uniform(-8, 8, 50), np.full(50, -1.8)])
    xyz = np.concatenate([*on, road])
    points = np.column_stack([xyz, np.full(len(xyz), intensity)]).astype(np.float32)
    return points, boxes, tuple(kind for kind, _, _ in things)


def test_each_class_has_its_table_and_a_band_only_where_objects_are():
    real = count_clouds([street(("Car", 10, 40), ("Pedestrian", 14.5, 30), ("Pedestrian", 20, 20), ("Cyclist", 60, 9))])
    raw = count_clouds([street(("Car", 10, 80), ("Pedestrian", 14.5, 10))])
    tables = check_tables({"real": real, "raw_64": raw}, "Car")
    assert list(tables) == ["Whole scenes", "Car", "Pedestrian", "Cyclist"]
    heads, rows = tables["Car"]
    assert [head for head in heads if head.startswith("on one")] == ["on one, 0-15 m"]
    assert [row[:3] for row in rows] == [["real", "1", "40"], ["raw_64", "1", "80"]]
    heads, rows = tables["Pedestrian"]
    assert [head for head in heads if head.startswith("on one")] == ["on one, 0-15 m", "on one, 15-30 m"]
    assert [row[1:4] for row in rows] == [["2", "30", "20"], ["1", "10", "-"]]
    heads, rows = tables["Cyclist"]
    assert [head for head in heads if head.startswith("on one")] == ["on one, 45-80 m"]
    assert [row[2] for row in rows] == ["9", "-"]
    assert rows[1][3:] == ["-", "-", "-"]  # no cyclist, no distance of distributions


def test_the_checks_stand_without_any_detector(tmp_path):
    counts = {name: count_clouds([street(("Car", 10, 40), ("Van", 30, 30))]) for name in ("real", "raw_64")}
    assert checked_kinds(tmp_path) == ()
    pictures = write_checks(tmp_path, counts, "Car", {"clouds": np.zeros((8, 8, 3), np.uint8)})
    assert checked_kinds(tmp_path) == ("real", "raw_64")
    assert set(pictures) == {"clouds", "drops", "intensity", "on_car", "on_van", "elsewhere"}
    assert {path.stem for path in (tmp_path / "pictures").iterdir()} == set(pictures)
    plain = json.loads((tmp_path / "clouds.json").read_text())
    assert plain["classes"]["Van"]["raw_64"]["points_30_45"] == 30
    assert plain["classes"]["Van"]["raw_64"]["points_45_80"] is None
    assert "Van:" in (tmp_path / "clouds.md").read_text()


def test_a_class_chart_draws_range_height_and_intensity_of_its_own_points():
    """All points of a car at 10 m, at one intensity: the range has its peak there, intensity one bin."""
    counts = {"real": count_clouds([street(("Car", 10, 400), intensity=0.32)])}
    drawn = class_chart(counts, "Car")
    said = [s.text for s in drawn.strokes if hasattr(s, "text")]
    assert [words for words in said if words.endswith(("m", "cars"))] == [
        "range on cars, m", "height above the LiDAR on cars, m", "intensity on cars",
    ]  # fmt: skip
    lines = [s.points for s in drawn.strokes if hasattr(s, "points") and len(s.points) > 2]
    assert len(lines) == 3
    in_range, _, intensity = lines
    peak = in_range[in_range[:, 1].argmin(), 0]
    first, last = in_range[0, 0], in_range[-1, 0]
    assert (peak - first) / (last - first) == pytest.approx((10 - 1) / 18, abs=0.06)  # bins of 2 m, axis to 20 m
    full = intensity[:, 1] < intensity[:, 1].max() - 1
    assert full.sum() == 1
    elsewhere = [s.text for s in class_chart(counts, REST).strokes if hasattr(s, "text")]
    assert "range elsewhere, m" in elsewhere
