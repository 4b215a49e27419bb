"""Two folders of frames or clouds compared, as `python eval.py generation` does it."""

import numpy as np
import pytest

from jaxsim.data.polar_frames import write_frame, write_grid
from jaxsim.evaluate.generation import generation_scores, open_folder, spaced
from jaxsim.frame import PolarGrid, PolarImage

ROWS, COLUMNS = 20, 48


def write_polar(folder, seed: int, *, gain: float = 1.0, semantic: bool = True, names: str = "abc"):
    rng = np.random.default_rng(seed)
    grid = PolarGrid(
        np.linspace(0.6, -0.6, COLUMNS).astype(np.float32),
        np.linspace(0.0, -0.4, ROWS).astype(np.float32),
        np.zeros(ROWS, np.float32),
    )
    write_grid(folder, grid)
    for name in names:
        range_m = rng.uniform(5, 60, (ROWS, COLUMNS)).astype(np.float32)
        label = rng.choice([7, 11], (ROWS, COLUMNS))
        intensity = np.clip(gain * np.where(label == 7, 0.3, 0.6) * (1 - range_m / 90), 0, 1).astype(np.float32)
        more = {"semantic": label.astype(np.uint8)} if semantic else {}
        write_frame(folder, name, PolarImage(range_m, intensity, rng.random((ROWS, COLUMNS)) < 0.9), **more)
    return folder


def test_a_folder_has_no_distance_from_itself_and_is_told_why(tmp_path, caplog):
    folder = open_folder(write_polar(tmp_path / "a", 0))
    scores = generation_scores(folder, folder)
    for name, score in scores.items():
        if not name.endswith("floor") and np.isfinite(score.value):
            assert score.value == pytest.approx(0, abs=1e-6), name
    assert scores["chamfer_distance_m"].count == 3
    assert {"lidargen_jsd", "lidargen_mmd", "r2dm_jsd", "r2dm_mmd", "lidm_jsd", "swd_16", "swd_mean"} <= {*scores}
    assert "the points of 3 of 3 frames of one name are the same in" in caplog.text


def test_a_dimmer_sensor_shows_in_intensity_and_not_in_the_clouds(tmp_path):
    a, b = (open_folder(write_polar(tmp_path / n, 0, gain=g)) for n, g in (("a", 0.7), ("b", 1.0)))
    scores = generation_scores(a, b)
    assert scores["r2dm_jsd"].value == pytest.approx(0, abs=1e-6)
    assert scores["intensity_given_class"].value > 5 * scores["intensity_given_class_floor"].value
    assert scores["swd_mean"].value == pytest.approx(0, abs=0.5)


def test_classes_of_the_simulated_twin_stand_for_those_that_measured_frames_lack(tmp_path, caplog):
    a = open_folder(write_polar(tmp_path / "a", 0))
    twin = open_folder(write_polar(tmp_path / "b", 0, semantic=False))
    assert "intensity_given_class" in generation_scores(a, twin)
    stranger = open_folder(write_polar(tmp_path / "c", 1, semantic=False, names="xyz"))
    caplog.clear()
    scores = generation_scores(a, stranger)
    assert "intensity_given_class" not in scores
    assert "intensity_given_all" in scores
    assert "chamfer_distance_m" not in scores
    other = open_folder(write_polar(tmp_path / "d", 2))
    assert generation_scores(a, other)["chamfer_distance_m"].value > 0
    assert not caplog.messages


@pytest.mark.long
def test_clouds_have_the_distances_that_clouds_allow(tmp_path):
    rng = np.random.default_rng(3)
    for side in "ab":
        (tmp_path / side).mkdir()
        for k in range(2):
            xyz = (rng.standard_normal((500, 3)) * [15, 15, 1]).astype("<f4")
            if side == "a":
                np.concatenate([xyz, np.zeros((500, 1), "<f4")], 1).tofile(tmp_path / side / f"{k}.bin")
            else:
                np.savez(tmp_path / side / f"{k}.npz", xyz=xyz)
    scores = generation_scores(open_folder(tmp_path / "a"), open_folder(tmp_path / "b"))
    assert scores["chamfer_distance_m"].count == 2
    assert scores["r2dm_jsd"].value > 0.3
    assert not any(name.startswith(("swd", "intensity")) for name in scores)


def test_a_cloud_is_read_from_the_file_that_was_listed(tmp_path):
    points = np.float32([[1, 2, 3, 0.5], [4, 5, 6, 0.25]])
    points.tofile(tmp_path / "a.BIN")
    np.testing.assert_array_equal(open_folder(tmp_path).points("a"), points)


@pytest.mark.long
def test_what_adds_up_is_of_all_frames_and_what_is_compared_of_some_evenly_spaced(tmp_path):
    a = open_folder(write_polar(tmp_path / "a", 0, names="abcdefghi"))
    b = open_folder(write_polar(tmp_path / "b", 1, names="abcdefghi"))
    few_a = open_folder(write_polar(tmp_path / "c", 0, names="abcdefghi"))
    few_b = open_folder(write_polar(tmp_path / "d", 1, names="abcdefghi"))
    for name in "bcdfgh":
        for folder in (few_a, few_b):
            (folder.path / f"{name}.npz").unlink()
    assert spaced(a.names, 3) == ["a", "e", "i"]
    whole, some = generation_scores(a, b), generation_scores(a, b, compared=3)
    alone = generation_scores(open_folder(few_a.path), open_folder(few_b.path))
    for name, score in some.items():
        compared = name.endswith("_mmd") or name.startswith("swd")
        assert score.value == pytest.approx((alone if compared else whole)[name].value, nan_ok=True), name
        assert score.count == (3 if compared else whole[name].count), name
    assert whole["r2dm_mmd"].count == 9


def test_a_cloud_without_a_point_in_a_definitions_ranges_is_named(tmp_path):
    a, b = (write_polar(tmp_path / name, 0) for name in "ab")
    write_frame(b, "b", PolarImage(*(np.zeros((ROWS, COLUMNS), kind) for kind in ("f4", "f4", bool))))
    with pytest.raises(
        ValueError, match=r"^generation: .*b/b has no point within the ranges of .*; leave it out of both"
    ):
        generation_scores(open_folder(a), open_folder(b))


def test_a_cloud_without_points_is_named_also_where_it_is_not_compared(tmp_path):
    a, b = (write_polar(tmp_path / name, 0) for name in "ab")
    write_frame(b, "b", PolarImage(*(np.zeros((ROWS, COLUMNS), kind) for kind in ("f4", "f4", bool))))
    with pytest.raises(ValueError, match=r"^generation: b: chamfer: a cloud is empty; leave the frame out"):
        generation_scores(open_folder(a), open_folder(b), compared=2)


def test_polar_frames_that_lost_their_grid_are_told_apart_from_clouds(tmp_path):
    folder = write_polar(tmp_path / "a", 0)
    (folder / "grid.json").unlink()
    with pytest.raises(ValueError, match=r"a\.npz holds no array xyz .* but .*range.*its folder lacks grid\.json"):
        open_folder(folder).points("a")


def test_a_folder_without_frames_is_an_error(tmp_path):
    with pytest.raises(ValueError, match="holds no frames"):
        open_folder(tmp_path)
