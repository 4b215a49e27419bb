"""Sets of pairs on disk: the pairs that frames give, the same bytes whoever makes them, and nothing of another set."""

import hashlib
import json
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import jax
import numpy as np
import pytest
import tensorflow_datasets as tfds

from jaxsim.config import DataConfig, Experiment, PrepareConfig
from jaxsim.data import open_dataset, select
from jaxsim.data.batches import batches
from jaxsim.data.records import example_of
from jaxsim.data.tfds_builder import JaxsimPairs, Shard, cut
from jaxsim.geometry import preset
from jaxsim.pairs import shards as pair_shards
from jaxsim.pairs.prepared import make_record, prepared
from jaxsim.pairs.sets import make_set
from jaxsim.pairs.shards import Job, make_all
from jaxsim.runs.run import describe

PREPARE = PrepareConfig(inputs=("rgb", "depth", "row"), depth="ip_basic_fast", columns=64)


def kitti(root: Path, **more) -> DataConfig:
    return DataConfig(kind="kitti_raw", root=root, **more)


def of(out: Path) -> DataConfig:
    return DataConfig(kind="prepared", root=out)


def equal(one, other) -> None:
    assert jax.tree.structure(one) == jax.tree.structure(other)
    for a, b in zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True):
        assert np.asarray(a).dtype == np.asarray(b).dtype
        np.testing.assert_array_equal(a, b)


def digests(folder: Path) -> dict[str, str]:
    """Of every file of a set but the lock."""
    files = [path for path in folder.rglob("*") if path.is_file()]
    return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


@pytest.fixture
def out(raw_root, tmp_path) -> Path:
    """All three frames of the drives, two of them for training; two pairs a file."""
    make_set(tmp_path / "out", kitti(raw_root), PREPARE, train="0-1", evaluation="2", size=2, workers=1)
    return tmp_path / "out"


def test_a_set_holds_the_pairs_that_its_frames_give_and_the_papers_parts(step_tree, tmp_path):
    data = DataConfig(kind="kitti_step", root=step_tree, scenes=("0000", "0001"), cache=tmp_path / "cache")
    settings = PrepareConfig(depth="ip_basic_fast", denoise="non_local_means")
    make_set(tmp_path / "out", data, settings, workers=1)
    frames, pairs = open_dataset(data), open_dataset(of(tmp_path / "out"))
    assert len(pairs) == len(frames) == 2
    for part, own in (("training", "train"), ("evaluation", "eval")):
        chosen = select(part, pairs)
        assert chosen == select(own, pairs) == select(part, frames)
        direct = prepared(frames, chosen, data, prepare=settings)
        kept = prepared(pairs, chosen, of(tmp_path / "out"), prepare=settings)
        assert kept.entries == direct.entries
        assert pairs.name_of(chosen[0]) == frames.name_of(chosen[0])
        for i in range(len(kept)):
            one, other = kept.record(i), direct.record(i)
            equal((one.pair, one.grid, one.edges), (other.pair, other.grid, other.edges))
            assert (one.name, one.scene, one.position) == (other.name, other.scene, chosen[i])
            assert one.edges.any()
        from_frame = describe(Experiment(), frames.spec, frames[chosen[0]].camera)
        assert describe(Experiment(), pairs.spec, kept.record(0).view) == from_frame


@pytest.mark.parametrize("parts", [1, 2])
def test_training_sees_the_same_batches_from_a_set_as_from_frames(raw_root, out, tmp_path, parts):
    loaders = []
    for data in (kitti(raw_root, cache=tmp_path / "cache"), of(out)):
        pairs = prepared(open_dataset(data), [2, 0, 1], data, prepare=PREPARE)
        loaders.append([batches(pairs, size=2, seed=4, flip=True, part=i, parts=parts) for i in range(parts)])
    for k in range(4):
        for direct, kept in zip(*loaders, strict=True):
            equal(direct[k], kept[k])


def test_tfds_reads_a_set_without_jaxsim_and_builds_one_in_its_own_way(raw_root, out, tmp_path):
    frames = open_dataset(kitti(raw_root))

    def examples(positions):
        return (example_of(make_record(frames[p], p, frames.spec, prepare=PREPARE)) for p in positions)

    shards = cut({"train": [0, 1], "eval": [2]}, 1)
    JaxsimPairs(data_dir=tmp_path / "own", kind="kitti_raw", shards=shards, examples=examples).download_and_prepare()
    for split, names in (("train", [frames.name_of(0), frames.name_of(1)]), ("eval", [frames.name_of(2)])):
        sources = [tfds.data_source("jaxsim_pairs/kitti_raw", split=split, data_dir=d) for d in (out, tmp_path / "own")]
        assert [record["name"].decode() for record in sources[0]] == names
        for one, other in zip(*sources, strict=True):
            equal(one, other)
        assert sources[0][0]["painted"]["rgb"].shape[1:] == (64, 3)


@pytest.mark.slow  # test_prepare_command.py shows as much on its way
def test_many_processes_make_the_records_that_one_makes_in_order(raw_root):
    job = Job(kitti(raw_root), PREPARE, open_dataset(kitti(raw_root)).spec, scan=True)
    positions = [2, 0, 1, 0, 2] * 3
    assert list(make_all(job, positions, workers=2)) == list(make_all(job, positions, workers=1))


def test_what_stopped_at_half_goes_on_to_the_bytes_of_what_did_not(raw_root, out, tmp_path, monkeypatch):
    settings = {"train": "0-1", "evaluation": "2", "workers": 1}
    make_set(tmp_path / "whole", kitti(raw_root), PREPARE, size=1, **settings)
    made, make = [], pair_shards.make

    def breaks_off(job, position):
        if position == 1 and len(made) < 2:
            raise KeyboardInterrupt
        made.append(position)
        return make(job, position)

    monkeypatch.setattr(pair_shards, "make", breaks_off)
    with pytest.raises(KeyboardInterrupt):
        make_set(tmp_path / "half", kitti(raw_root), PREPARE, size=1, **settings)
    with pytest.raises(ValueError, match=r"1\.0\.0\.making is not finished; the jaxsim prepare that began it"):
        open_dataset(of(tmp_path / "half"))
    (tmp_path / "half/jaxsim_pairs/kitti_raw/1.0.0.making/.7.jaxsim_pairs-train.array_record-00001-of-00002").touch()
    made.append(None)
    made.append(None)
    make_set(tmp_path / "half", kitti(raw_root), PREPARE, size=1, **settings)
    assert made == [0, None, None, 1, 2]
    assert sorted(path.name for path in (tmp_path / "half/jaxsim_pairs/kitti_raw/1.0.0").iterdir()) == [
        *("dataset_info.json", "features.json", "jaxsim_pairs-eval.array_record-00000-of-00001"),
        *(f"jaxsim_pairs-train.array_record-0000{k}-of-00002" for k in range(2)),
        "metadata.json",
    ]
    assert digests(tmp_path / "half" / "jaxsim_pairs") == digests(tmp_path / "whole" / "jaxsim_pairs")


def test_a_finished_set_is_not_made_again(raw_root, out, monkeypatch):
    monkeypatch.setattr(pair_shards, "make", None)
    before = digests(out)
    make_set(out, kitti(raw_root), PREPARE, train="0-1", evaluation="2", workers=1)
    assert digests(out) == before


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"prepare": replace(PREPARE, columns=32)}, r"prepare\.columns was 64, now 32.*another --out"),
        ({"data": {"rows": "elevation"}}, r"data\.rows was file_order, now elevation"),
        ({"train": "0"}, r"train was \[0, 1\], now \[0\]"),
        ({"evaluation": ""}, r"eval was \[2\], now None"),
    ],
)
@pytest.mark.parametrize("finished", [True, False])
def test_a_set_of_other_settings_is_not_added_to(raw_root, out, change, message, finished):
    if not finished:
        folder = out / "jaxsim_pairs/kitti_raw/1.0.0"
        plan = {"code": "", "splits": {"train": [0, 1], "eval": [2]}, "pairs-a-file": 2}
        about = json.loads((folder / "metadata.json").read_text())
        (folder / "plan.json").write_text(json.dumps({**about["settings"], **plan}))
        folder.rename(folder.with_name("1.0.0.making"))
    data = kitti(raw_root, **change.get("data", {}))
    settings = {"train": change.get("train", "0-1"), "evaluation": change.get("evaluation", "2"), "size": 2}
    with pytest.raises(ValueError, match=message):
        make_set(out, data, change.get("prepare", PREPARE), **settings, workers=1)


def test_files_of_other_code_are_not_mixed_with_new_ones(raw_root, tmp_path, monkeypatch):
    monkeypatch.setattr(pair_shards, "make", None)
    for code in ("old", "new"):
        monkeypatch.setattr("jaxsim.pairs.sets.fingerprint", lambda *_, code=code: code)
        with pytest.raises((TypeError, ValueError), match="not callable" if code == "old" else "code was"):
            make_set(tmp_path, kitti(raw_root), PREPARE, workers=1)


def test_a_damaged_record_is_named_with_its_file_and_never_read_otherwise(raw_root, tmp_path):
    make_set(tmp_path, kitti(raw_root), PREPARE, size=2, workers=1)
    path = tmp_path / "jaxsim_pairs/kitti_raw/1.0.0/jaxsim_pairs-train.array_record-00000-of-00002"
    sound = path.read_bytes()
    whole = list(open_dataset(of(tmp_path)).pairs(range(3), PREPARE))
    found: set[tuple[int, ...]] = set()
    for place in range(0, len(sound), 3001):
        path.write_bytes(sound[:place] + bytes([sound[place] ^ 255]) + sound[place + 1 :])
        pairs, damaged = open_dataset(of(tmp_path)).pairs(range(3), PREPARE), []
        for i in range(3):
            try:
                equal(pairs[i], whole[i])
            except ValueError as error:
                assert f"{path}, record {i} ({pairs.names[i]}) is damaged" in str(error)  # noqa: PT017
                assert "copy the file again" in str(error)  # noqa: PT017
                damaged.append(i)
        found.add(tuple(damaged))
    assert {(0,), (1,)} <= found  # and nowhere the third, which lies in another file
    assert not any(2 in damaged for damaged in found)

    path.write_bytes(sound[:-1])
    with pytest.raises(ValueError, match=rf"{path.name} has {len(sound) - 1} bytes and was written with {len(sound)}"):
        open_dataset(of(tmp_path))
    path.unlink()
    with pytest.raises(ValueError, match=rf"{path.name} is not there; copy it again"):
        open_dataset(of(tmp_path))


def test_a_file_of_another_set_is_no_part_of_this_one(raw_root, tmp_path):
    for name, frames in (("one", "0"), ("other", "1")):
        make_set(tmp_path / name, kitti(raw_root), PREPARE, train=frames, workers=1)
    file = "jaxsim_pairs/kitti_raw/1.0.0/jaxsim_pairs-train.array_record-00000-of-00001"
    shutil.copy(tmp_path / "other" / file, tmp_path / "one" / file)
    with pytest.raises(ValueError, match=r"record 0 \(2011_09_26_drive_0001_sync-0000000000\) is damaged .*it holds"):
        prepared(open_dataset(of(tmp_path / "one")), [0], of(tmp_path / "one"), prepare=PREPARE)[0]


def test_what_a_set_does_not_hold_or_was_not_made_for_is_an_error(raw_root, out, tmp_path):
    make_set(tmp_path / "few", kitti(raw_root), PREPARE, train="0", evaluation="2", workers=1)
    few = open_dataset(of(tmp_path / "few"))
    with pytest.raises(ValueError, match=r"frame 1 of kitti_raw is not in .*train: 1, eval: 1 frames"):
        few.pairs([1], PREPARE)
    with pytest.raises(ValueError, match=r"other settings \(--prepare\.depth was ip_basic_fast, now ip_basic\)"):
        few.pairs([0], replace(PREPARE, depth="ip_basic"))
    with pytest.raises(ValueError, match="without class labels, which the inputs semantic need"):
        few.pairs([0], replace(PREPARE, inputs=("rgb", "semantic")))
    with pytest.raises(ValueError, match=rf"not the frames .*--data kitti_raw --root {raw_root}"):
        few[0]
    free = replace(PREPARE, inputs=("row",), network_size=(32, 64), max_range_m=80.0)
    assert len(few.pairs([0, 2], free)) == 2


def test_folders_without_a_set_say_what_there_is(raw_root, out, tmp_path):
    with pytest.raises(ValueError, match=r"no prepared set: .* holds 2011_09_26/; pass the --out of jaxsim prepare"):
        open_dataset(of(raw_root))
    with pytest.raises(ValueError, match="there is no folder"):
        open_dataset(of(tmp_path / "nowhere"))
    shutil.copytree(out / "jaxsim_pairs/kitti_raw", out / "jaxsim_pairs/kitti_step")
    with pytest.raises(ValueError, match=r"holds several sets; pass one of .*kitti_raw/1\.0\.0, .*kitti_step/1\.0\.0"):
        open_dataset(of(out))
    assert len(open_dataset(of(out / "jaxsim_pairs/kitti_raw"))) == 3


def test_frames_that_are_not_there_stop_before_anything_is_written(raw_root, step_root, tmp_path):
    out = tmp_path / "out"
    with pytest.raises(ValueError, match="pass the folder that holds training/"):
        make_set(out, DataConfig(kind="kitti_step", root=raw_root), PREPARE)
    with pytest.raises(ValueError, match=r"no sequence 0003.*--data\.scenes 0000 0001"):
        make_set(out, DataConfig(kind="kitti_step", root=step_root, scenes=("0000", "0003")), PREPARE)
    for image in (step_root / "training/image_02/0000").iterdir():
        image.unlink()
    with pytest.raises(ValueError, match=r"no NUMBER\.png in .*0000"):
        make_set(out, DataConfig(kind="kitti_step", root=step_root, scenes=("0000",)), PREPARE)
    with pytest.raises(ValueError, match=r"synthetic has 1000000 frames; say which: --train 0-159"):
        make_set(out, DataConfig(), PREPARE)
    with pytest.raises(ValueError, match=r"1 frames are both for training and for evaluation \(the first: 1,"):
        make_set(out, kitti(raw_root), PREPARE, train="0-1", evaluation="1-2")
    with pytest.raises(ValueError, match="a file holds one or more"):
        make_set(out, kitti(raw_root), PREPARE, size=0)
    assert not out.exists()


class Nothing:
    """A data set that lost its frames."""

    name, spec = "kitti_raw", preset("hdl64e")

    def __len__(self) -> int:
        return 0

    def __getitem__(self, index: int):
        raise IndexError

    def name_of(self, index: int) -> str:
        raise IndexError


def test_a_data_set_without_frames_is_empty(monkeypatch, raw_root, tmp_path):
    monkeypatch.setattr("jaxsim.pairs.sets.open_dataset", lambda data: Nothing())
    with pytest.raises(ValueError, match="kitti_raw has no frames here; look into its root"):
        make_set(tmp_path, kitti(raw_root), PREPARE)


def test_a_frame_that_lacks_something_is_named_and_what_was_made_stays(raw_root, tmp_path):
    bad = raw_root / "2011_09_26/2011_09_26_drive_0001_sync/velodyne_points/data/0000000001.bin"
    sound = bad.read_bytes()
    bad.write_bytes(sound[:-3])
    with pytest.raises(ValueError, match=r"0000000001\.bin is truncated"):
        make_set(tmp_path, kitti(raw_root), PREPARE, size=1, workers=1)
    (made,) = (tmp_path / "jaxsim_pairs/kitti_raw/1.0.0.making").glob("*array_record*")
    stamp = made.stat().st_mtime_ns
    bad.write_bytes(sound)
    folder = make_set(tmp_path, kitti(raw_root), PREPARE, size=1, workers=1)
    assert (folder / made.name).stat().st_mtime_ns == stamp


@pytest.mark.parametrize("kind", ["kitti_object", "kitti_tracking"])
def test_the_other_readers_frames_come_back_as_their_pairs(kind, object_root, step_tree, tmp_path):
    root, settings = (object_root, PREPARE) if kind == "kitti_object" else (step_tree, replace(PREPARE, columns=372))
    scenes = ("0000",) if kind == "kitti_tracking" else ()
    data = DataConfig(kind=kind, root=root, scenes=scenes, cache=tmp_path / "cache")
    make_set(tmp_path, data, settings, train="0", workers=1)
    (direct,) = prepared(open_dataset(data), [0], data, prepare=settings)
    (kept,) = prepared(open_dataset(of(tmp_path)), [0], of(tmp_path), prepare=settings)
    equal(kept, direct)


def test_real_frames_come_back_as_their_pairs(samples, tmp_path):
    data = DataConfig(kind="kitti_raw", root=samples / "kitti_raw", cache=tmp_path / "cache")
    settings = replace(PREPARE, columns=372)
    make_set(tmp_path, data, settings, train="0,5", workers=1)
    direct, kept = (prepared(open_dataset(d), [0, 5], d, prepare=settings) for d in (data, of(tmp_path)))
    assert kept.windows == {(44, 372)}
    for one, other in zip(direct, kept, strict=True):
        equal(one, other)


def test_two_commands_do_not_write_to_one_folder(raw_root, out):
    code = "import sys; from pathlib import Path; from jaxsim.files import lock; lock(Path(sys.argv[1]))"
    command = [sys.executable, "-c", f"{code}; print('held', flush=True); sys.stdin.read()", out]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout.readline() == "held\n"
        with pytest.raises(ValueError, match=rf"pid {other.pid} on .* is writing to .* another --out"):
            make_set(out, kitti(raw_root), PREPARE, train="0-1", evaluation="2", workers=1)
        other.communicate()
    make_set(out, kitti(raw_root), PREPARE, train="0-1", evaluation="2", workers=1)


def test_a_renderers_set_is_the_generators_inputs_and_is_not_trained_on(virtual, tmp_path):
    data = DataConfig(kind="vkitti2", root=virtual.root, scenes=("Scene01",))
    settings = PrepareConfig(columns=64)
    make_set(tmp_path, data, settings, workers=1)
    (first, _) = tfds.data_source("jaxsim_pairs/vkitti2", split="train", data_dir=tmp_path)
    assert first["painted"]["valid"].mean() > 0.5
    assert len(np.unique(first["painted"]["semantic"])) > 3
    assert not first["measured"]["valid"].any()
    assert not first["target"].any()
    with pytest.raises(ValueError, match="no LiDAR measured the frames"):
        prepared(open_dataset(of(tmp_path)), [0], of(tmp_path), prepare=settings)


def test_files_are_cut_so_that_the_last_takes_what_is_left():
    shards = cut({"train": list(range(5)), "eval": [7]}, 2)
    assert [shard.positions for shard in shards] == [(0, 1), (2, 3), (4,), (7,)]
    assert shards[2] == Shard("train", 2, 3, (4,))
    assert shards[2].file(Path("a")).name == "jaxsim_pairs-train.array_record-00002-of-00003"
