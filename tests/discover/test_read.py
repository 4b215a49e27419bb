"""Two folders to a comparison, or a reason why not."""

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.blind.hidden.case import make_case
from jaxsim.data.polar_frames import read_frame, write_frame, write_grid
from jaxsim.discover import read
from jaxsim.discover.read import read_comparison, read_part
from jaxsim.frame import PolarGrid, PolarImage

pytestmark = pytest.mark.usefixtures("standard_promotion")
GRID = PolarGrid(
    np.linspace(1, -1, 12, dtype=np.float32), np.linspace(0, -0.3, 6, dtype=np.float32), np.zeros(6, np.float32)
)


@pytest.fixture
def folders(tmp_path: Path) -> tuple[Path, Path]:
    rng = np.random.default_rng(0)
    streets_m = rng.uniform(3, 60, (3, 6, 12))
    for side in ("simulated", "measured"):
        for k, street_m in enumerate(streets_m):
            image = PolarImage(
                (street_m + rng.normal(0, 0.02, street_m.shape)).astype(np.float32),
                rng.uniform(0.1, 0.6, (6, 12)).astype(np.float32),
                np.ones((6, 12), bool),
            )
            write_frame(tmp_path / side, f"f{k}", image)
        write_grid(tmp_path / side, GRID, frames={f"f{k}": {"scene": f"s{k}", "time": 2.0 * k} for k in range(3)})
    return tmp_path / "simulated", tmp_path / "measured"


def test_single_frames_that_are_no_pair_are_left_out_and_told(tmp_path):
    make_case(tmp_path / "case", effect="none", seed=11, scenes=6, rows=16, columns=96)
    simulated, measured = tmp_path / "case/simulated", tmp_path / "case/measured"
    first, second, *rest = sorted(measured.glob("*.npz"))
    first.rename(measured / "kept.npz")
    second.rename(first)
    (measured / "kept.npz").rename(second)
    found = read_comparison(simulated, measured)
    assert found.names == tuple(path.stem for path in rest)
    told = [note for note in found.notes if note.startswith("left out: measured")]
    assert len(told) == 2
    assert f"measured {first.stem} agrees with simulated {second.stem}" in told[0]


def change_grid(folder: Path, **new) -> None:
    content = json.loads((folder / "grid.json").read_text())
    (folder / "grid.json").write_text(json.dumps(content | new))


def test_pairs_come_with_their_scenes(folders):
    found = read_comparison(*folders)
    assert found.scenes == ("s0", "s1", "s2")
    assert found.measured.range_m.shape == (3, 6, 12)
    assert found.notes == ()


def test_frames_without_a_partner_are_left_out_and_told(folders):
    (folders[1] / "f2.npz").unlink()
    found = read_comparison(*folders)
    assert found.names == ("f0", "f1")
    assert "1 frames have no partner" in found.notes[0]


def test_of_many_frames_as_many_are_read_as_fit_evenly_over_scenes(folders, monkeypatch):
    monkeypatch.setattr(read, "FEWEST_FRAMES", 2)
    monkeypatch.setattr(read, "MOST_CELLS", 2 * 6 * 12)
    found = read_comparison(*folders)
    assert len(found.names) == 2
    assert "2 of 3 frames were compared, spread evenly over 2 scenes" in found.notes


def test_times_of_frames_that_are_read_later_count_from_the_same_moment(folders, monkeypatch):
    monkeypatch.setattr(read, "FEWEST_FRAMES", 2)
    monkeypatch.setattr(read, "MOST_CELLS", 2 * 6 * 12)
    found = read_comparison(*folders)
    times = dict(zip(found.names, np.asarray(found.scan.time_s), strict=True))
    (later,) = found.rest.names
    times[later] = float(read_part(found.rest, [later], like=found).scan.time_s[0])
    # f0, f1 and f2 are two seconds apart.
    assert times["f1"] - times["f0"] == times["f2"] - times["f1"] == 2


def test_times_count_from_the_recordings_first_frame_though_it_is_not_read(folders, monkeypatch):
    """As they do where its answer is simulated with."""
    monkeypatch.setattr(read, "FEWEST_FRAMES", 1)
    monkeypatch.setattr(read, "MOST_CELLS", 6 * 12)
    found = read_comparison(*folders)
    assert found.names == ("f1",)
    assert np.asarray(found.scan.time_s) == 2


@pytest.mark.parametrize(("long", "short", "most"), [(100, 10, 40), (10, 10, 30), (1000, 1, 16)])
def test_short_scenes_keep_their_frames_and_long_ones_are_thinned_evenly(long, short, most, monkeypatch):
    monkeypatch.setattr(read, "MOST_CELLS", most * 6 * 12)
    names = [f"{scene}{k:04d}" for scene, count in (("a", long), ("b", short), ("c", short)) for k in range(count)]
    kept = read.thin_frames(names, [name[0] for name in names], grid=GRID)
    assert len(kept) == min(most, len(names))
    assert kept == sorted(kept)
    assert sum(name[0] == "b" for name in kept) == min(short, most // 3)
    steps = np.diff([int(name[1:]) for name in kept if name[0] == "a"])
    assert steps.max() - steps.min() <= 1


def test_more_scenes_than_frames_fit_give_one_frame_each(monkeypatch):
    monkeypatch.setattr(read, "MOST_CELLS", 20 * 6 * 12)
    names = [f"{k:04d}" for k in range(200)]
    kept = read.thin_frames(names, [name[:3] for name in names], grid=GRID)
    assert [int(name) for name in kept] == list(range(5, 200, 10))


@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize(
    ("new", "message"),
    [
        ({"azimuth": np.linspace(-1, 1, 12).tolist()}, "must fall from column to column"),
        ({"azimuth": np.linspace(60, -60, 12).tolist()}, "radians, not degrees"),
        ({"azimuth": [float("nan")] * 12}, "NaN is no number of JSON"),
        ({"elevation": np.linspace(-0.3, 0, 6).tolist()}, "must fall from row to row, top beam first"),
        ({"frames": ["f0"]}, "NAME"),
        ({"frames": {"f0": {"scene": "other"}}}, "must be a pair"),
    ],
)
def test_a_grid_that_cannot_be_right(folders, side, new, message):
    change_grid(folders[side], **new)
    with pytest.raises(ValueError, match=message):
        read_comparison(*folders)


def test_a_grid_that_is_no_json(folders):
    (folders[0] / "grid.json").write_text("{azimuth")
    with pytest.raises(ValueError, match="is not JSON"):
        read_comparison(*folders)


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 cut off", b"not an archive"])
def test_a_damaged_frame_is_named(folders, content):
    (folders[1] / "f1.npz").write_bytes(content)
    with pytest.raises(ValueError, match=r"f1\.npz is no readable"):
        read_comparison(*folders)


def test_a_frame_without_returns_and_one_without_light(folders):
    shape = (6, 12)
    nothing = PolarImage(np.zeros(shape, np.float32), np.zeros(shape, np.float32), np.zeros(shape, bool))
    write_frame(folders[1], "f0", nothing)
    with pytest.raises(ValueError, match="measured frame f0 is empty"):
        read_comparison(*folders)
    dark = PolarImage(np.full(shape, 9, np.float32), np.zeros(shape, np.float32), np.ones(shape, bool))
    write_frame(folders[1], "f0", dark)
    with pytest.raises(ValueError, match="intensity 0 everywhere"):
        read_comparison(*folders)


def rewrite(folder: Path, name: str, **more) -> None:
    """Gives a frame further rasters."""
    image, _ = read_frame(folder, name)
    write_frame(folder, name, image, **more)


@pytest.mark.parametrize("key", ["semantic", "instance", "incidence", "rgb", "time"])
def test_a_raster_of_some_frames_only(folders, key):
    rewrite(folders[0], "f1", **{key: np.ones((6, 12, 3) if key == "rgb" else (6, 12), np.uint8)})
    with pytest.raises(ValueError, match=rf"2 of 3 frames of .*simulated lack {key} \(f0, f2\)"):
        read_comparison(*folders)


def test_exchanged_folders_are_told_by_what_no_sensor_knows(folders):
    for name in ("f0", "f1", "f2"):
        rewrite(folders[1], name, incidence=np.ones((6, 12), np.float32))
    with pytest.raises(ValueError, match=r"no sensor knows.*exchange --measured and --simulated"):
        read_comparison(*folders)
    for name in ("f0", "f1", "f2"):
        rewrite(folders[0], name, incidence=np.ones((6, 12), np.float32))
    assert read_comparison(*folders).names == ("f0", "f1", "f2")


def test_a_measured_frame_that_is_a_copy_is_named(folders):
    (folders[1] / "f2.npz").write_bytes((folders[1] / "f0.npz").read_bytes())
    with pytest.raises(ValueError, match=r"f0 and f2 of .*measured hold the same readings"):
        read_comparison(*folders)


def test_a_frame_that_is_a_copy_on_both_sides_counts_once(folders):
    for folder in folders:
        (folder / "f2.npz").write_bytes((folder / "f0.npz").read_bytes())
    comparison = read_comparison(*folders)
    assert comparison.names == ("f0", "f1")
    assert "left out: f2 holds the readings of f0 on both sides: a copy" in comparison.notes


def test_an_intensity_that_is_the_same_everywhere_is_refused_measured_and_told_simulated(folders):
    def level(folder):
        for name in ("f0", "f1", "f2"):
            image, _ = read_frame(folder, name)
            write_frame(folder, name, image.replace(intensity=np.full((6, 12), 0.5, np.float32)))

    level(folders[0])
    assert "simulated intensity is 0.5 everywhere" in read_comparison(*folders).notes[0]
    level(folders[1])
    with pytest.raises(ValueError, match=r"measured intensity is 0\.5 everywhere"):
        read_comparison(*folders)


@pytest.mark.parametrize(("step_s", "told"), [(0.1, True), (2.0, False), (None, False)])
def test_frames_without_a_scene_are_told_and_more_so_where_they_are_consecutive(folders, step_s, told):
    about = {f"f{k}": {} if step_s is None else {"time": step_s * k} for k in range(3)}
    for folder in folders:
        change_grid(folder, frames=about)
    found = read_comparison(*folders)
    assert found.scenes == ("f0", "f1", "f2")
    (note,) = found.notes
    assert "3 of 3 frames have no scene" in note
    assert ("0.1 s apart" in note and "Do not trust" in note) == told
