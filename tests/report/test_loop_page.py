"""The loop's tables and page, from scores and clouds that were made up."""

import json
from dataclasses import replace

import numpy as np
import pytest

import configs
from jaxsim.effects.chain import SensorModel
from jaxsim.metrics.cloud_checks import count_clouds
from jaxsim.metrics.detection import COLUMNS, DIFFICULTIES, Curve
from jaxsim.report.loop import answer, loop_tables, write_loop
from jaxsim.report.loop_charts import epochs_chart, intensity_chart
from jaxsim.simulate.loop import settle_loop, write_score

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
    config, _ = configs.load_loop("real2sim2real")
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
    assert "| raw_64 | 90 | 90 |" in text


def test_the_page_stands_alone_and_the_json_is_strict(loop):
    counts = {kind: clouds(value) for kind, value in COUNTS.items()}
    page = write_loop(loop, counts, {"found": np.zeros((8, 8, 3), np.uint8)})
    html = page.read_text()
    assert "http" not in html.replace("http://www.w3.org", "")
    assert html.count("data:image/png") == 4
    assert "<b>nan" not in html.lower()

    def refuse(name):
        raise AssertionError(name)

    plain = json.loads((loop.out / "real2sim2real.json").read_text(), parse_constant=refuse)
    moderate = next(r for r in plain["on_real"] if (r["clouds"], r["difficulty"]) == ("simulated_64", "moderate"))
    assert moderate["3D@0.7"]["paper"] == 51.74
    assert moderate["3D@0.7"]["value"] == pytest.approx(56)
    assert plain["clouds"]["raw_64"]["intensity"] == pytest.approx(0.4, abs=0.01)
    drawn = {p.stem for p in (loop.out / "pictures").iterdir()}
    assert drawn == {"found", "drops", "intensity", "epochs"}


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
