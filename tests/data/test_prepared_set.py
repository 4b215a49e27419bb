"""Sets of pairs on disk: the pairs that frames give, the same bytes whoever makes them, and nothing of another set."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
import tensorflow_datasets as tfds

from jaxsim.config import DataConfig, Experiment, PrepareConfig
from jaxsim.data import open_dataset, select
from jaxsim.data.batches import batches
from jaxsim.data.records import example_of
from jaxsim.data.tfds_builder import JaxsimPairs, shards_of
from jaxsim.pairs.prepared import make_record, prepared
from jaxsim.pairs.sets import make_set
from jaxsim.runs.run import describe_run
from tests.data.made_prepared_set import PREPARE, equal, kitti, of


@pytest.mark.long
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
        from_frame = describe_run(Experiment(), frames.spec, frames[chosen[0]].camera)
        assert describe_run(Experiment(), pairs.spec, kept.record(0).view) == from_frame


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

    shards = shards_of({"train": [0, 1], "eval": [2]}, 1)
    JaxsimPairs(data_dir=tmp_path / "own", kind="kitti_raw", shards=shards, examples=examples).download_and_prepare()
    for split, names in (("train", [frames.name_of(0), frames.name_of(1)]), ("eval", [frames.name_of(2)])):
        sources = [tfds.data_source("jaxsim_pairs/kitti_raw", split=split, data_dir=d) for d in (out, tmp_path / "own")]
        assert [record["name"].decode() for record in sources[0]] == names
        for one, other in zip(*sources, strict=True):
            equal(one, other)
        assert sources[0][0]["painted"]["rgb"].shape[1:] == (64, 3)


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


def test_a_set_that_names_no_file_of_a_part_is_refused(raw_root, tmp_path):
    folder = make_set(tmp_path, kitti(raw_root), PREPARE, workers=1)
    metadata = folder / "metadata.json"
    metadata.write_text(json.dumps(json.loads(metadata.read_text()) | {"files": {}}))
    with pytest.raises(ValueError, match=r"metadata\.json names no file of train; copy it again, or make the set anew"):
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


@pytest.mark.parametrize("told", [True, False])
def test_a_set_of_frames_without_image_gives_no_colours(odometry_root, tmp_path, told):
    data = DataConfig(kind="kitti_odometry", root=odometry_root)
    settings = replace(PREPARE, inputs=("depth", "row"))
    folder = make_set(tmp_path / "out", data, settings, train="0-1", workers=1)
    if not told:  # a set of before
        about = json.loads((folder / "metadata.json").read_text())
        assert about["splits"]["train"].pop("pictured") == [True, False]
        (folder / "metadata.json").write_text(json.dumps(about))
    pairs = open_dataset(of(tmp_path / "out"))
    assert len(list(pairs.pairs([0, 1], settings))) == 2
    coloured = replace(settings, inputs=("rgb", "depth"))
    assert pairs.pairs([0], coloured)[0].painted.rgb.any()
    with pytest.raises(ValueError, match="sequence_00-000001 has no image, which the inputs rgb need"):
        pairs.pairs([0, 1], coloured)[1]


def test_folders_without_a_set_say_what_there_is(raw_root, out, tmp_path):
    with pytest.raises(ValueError, match=r"no prepared set: .* holds 2011_09_26/; pass the --out of jaxsim prepare"):
        open_dataset(of(raw_root))
    with pytest.raises(ValueError, match="there is no folder"):
        open_dataset(of(tmp_path / "nowhere"))
    shutil.copytree(out / "jaxsim_pairs/kitti_raw", out / "jaxsim_pairs/kitti_step")
    with pytest.raises(ValueError, match=r"holds several sets; pass one of .*kitti_raw/1\.0\.0, .*kitti_step/1\.0\.0"):
        open_dataset(of(out))
    assert len(open_dataset(of(out / "jaxsim_pairs/kitti_raw"))) == 3


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
