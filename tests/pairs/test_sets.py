"""Sets are made once, from one data set with one making."""

import json
import os
import shutil
import subprocess
import sys
from dataclasses import replace

import pytest

from jaxsim.config import DataConfig, PrepareConfig
from jaxsim.data import open_dataset
from jaxsim.files.whole import HOST
from jaxsim.geometry import preset
from jaxsim.pairs import shards as pair_shards
from jaxsim.pairs.prepared import prepared
from jaxsim.pairs.sets import make_set
from tests.data.made_prepared_set import PREPARE, digests, kitti, of


class Nothing:
    """A data set that lost its frames."""

    name, spec = "kitti_raw", preset("hdl64e")

    def __len__(self) -> int:
        return 0

    def __getitem__(self, index: int):
        raise IndexError

    def name_of(self, index: int) -> str:
        raise IndexError


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
    killed = f".jaxsim-{HOST}-{os.getpid()}-{'0' * 9}"  # an earlier process that had this one's number
    making = tmp_path / "half/jaxsim_pairs/kitti_raw/1.0.0.making"
    (making / f"{killed}.jaxsim_pairs-train.array_record-00001-of-00002").touch()
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


def test_a_drive_that_came_since_an_earlier_set_of_the_process_has_its_place(raw_root, out):
    """It sorts before the others, and moves their positions."""
    earlier = raw_root / "2011_09_25" / "2011_09_25_drive_0001_sync"
    shutil.copytree(raw_root / "2011_09_26" / "2011_09_26_drive_0002_sync", earlier)
    for path in raw_root.glob("2011_09_26/*.txt"):
        shutil.copy(path, earlier.parent)
    make_set(out / "later", kitti(raw_root), PREPARE, train="0-1", workers=1)
    names = [open_dataset(data).name_of(i) for data in (kitti(raw_root), of(out / "later")) for i in (0, 1)]
    assert names[:2] == names[2:]


def mend(root):
    """Another calibration of the date, as one that was copied wrongly is mended."""
    (calibration,) = root.glob("2011_09_26/calib_velo_to_cam.txt")
    calibration.write_text(calibration.read_text().replace("-0.2717806", "-0.9717806"))


def test_a_finished_set_of_files_that_have_changed_is_refused(raw_root, out):
    mend(raw_root)
    with pytest.raises(
        ValueError, match=r"2 frames whose files have changed since \(the first: .*0001_sync-0000000000"
    ):
        make_set(out, kitti(raw_root), PREPARE, train="0-1", evaluation="2", workers=1)
    shutil.rmtree(raw_root)
    assert len(open_dataset(of(out)).pairs([0, 1, 2], PREPARE)[:]) == 3  # where its data are not, it serves as it is


def test_a_set_that_says_nothing_of_its_files_is_taken(raw_root, out):
    (metadata,) = out.rglob("metadata.json")
    about = json.loads(metadata.read_text())
    for split in about["splits"].values():
        assert all(split.pop("sources"))
    metadata.write_text(json.dumps(about))
    mend(raw_root)
    make_set(out, kitti(raw_root), PREPARE, train="0-1", evaluation="2", workers=1)


def test_a_set_made_anew_of_mended_files_has_other_keys(raw_root, out, tmp_path):
    mend(raw_root)
    settings = {"train": "0-1", "evaluation": "2", "workers": 1}
    make_set(tmp_path / "mended", kitti(raw_root), PREPARE, **settings)
    keys = [open_dataset(of(root)).pairs([0, 1, 2], PREPARE).keys for root in (out, tmp_path / "mended")]
    assert not {*keys[0]} & {*keys[1]}
    data = kitti(raw_root, cache=tmp_path / "cache")
    assert prepared(open_dataset(data), [0, 1, 2], data, prepare=PREPARE).keys == keys[1]


def test_files_of_pairs_whose_sources_changed_before_the_set_was_whole_are_made_anew(raw_root, tmp_path, monkeypatch):
    settings = {"train": "0-1", "evaluation": "2", "workers": 1, "size": 1}
    make, made = pair_shards.make, []

    def breaks_off(job, position):
        made.append(position)
        if made == [0, 1, 2]:
            raise KeyboardInterrupt
        return make(job, position)

    monkeypatch.setattr(pair_shards, "make", breaks_off)
    with pytest.raises(KeyboardInterrupt):
        make_set(tmp_path / "half", kitti(raw_root), PREPARE, **settings)
    (image,) = raw_root.glob("2011_09_26/2011_09_26_drive_0001_sync/image_02/data/0000000001.png")
    os.utime(image, ns=(1, 1))
    make_set(tmp_path / "half", kitti(raw_root), PREPARE, **settings)
    assert made == [0, 1, 2, 1, 2]


def test_files_of_other_code_are_not_mixed_with_new_ones(raw_root, tmp_path, monkeypatch):
    monkeypatch.setattr(pair_shards, "make", None)
    for code in ("old", "new"):
        monkeypatch.setattr("jaxsim.pairs.sets.pairs_fingerprint", lambda *_, code=code: code)
        with pytest.raises((TypeError, ValueError), match="not callable" if code == "old" else "code was"):
            make_set(tmp_path, kitti(raw_root), PREPARE, workers=1)


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


def test_where_the_parts_of_a_data_set_are_empty_all_of_it_is_for_training(odometry_root, tmp_path):
    """SemanticKITTI's parts are those of labelled scans."""
    for labels in odometry_root.glob("sequences/*/labels"):
        shutil.rmtree(labels)
    data = DataConfig(kind="kitti_odometry", root=odometry_root)
    make_set(tmp_path / "out", data, replace(PREPARE, inputs=("depth", "row")), workers=1)
    assert open_dataset(of(tmp_path / "out")).splits["train"] == [0, 1, 2, 3]


def test_all_that_frames_lack_is_told_at_once_and_before_anything_is_written(raw_root, tmp_path):
    with pytest.raises(ValueError, match="2011_09_26_drive_0001_sync-0000000000") as stop:
        make_set(tmp_path / "out", kitti(raw_root), PrepareConfig(image_crop=(400, 1216)), train="0-1", workers=1)
    said = str(stop.value)
    for part in (
        "--prepare.image-crop to at most 375 1242",
        "--prepare.depth ip_basic_fast",
        "the inputs semantic and edges need class labels",
        "--prepare.inputs rgb depth row",
    ):
        assert part in said
    assert not (tmp_path / "out").exists()


def test_a_place_whose_name_is_no_utf_8_is_told_before_anything_is_made(raw_root, tmp_path):
    with pytest.raises(UnicodeEncodeError, match="surrogates not allowed"):
        make_set(tmp_path / "lat\udcfc", kitti(raw_root), PREPARE)
    assert not (tmp_path / "lat\udcfc").exists()


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


def test_two_commands_do_not_write_to_one_folder(raw_root, out):
    code = "import sys; from pathlib import Path; from jaxsim.files import lock; lock(Path(sys.argv[1]))"
    command = [sys.executable, "-c", f"{code}; print('held', flush=True); sys.stdin.read()", out]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout.readline() == "held\n"
        with pytest.raises(ValueError, match=rf"pid {other.pid} on .* is writing to .* another --out"):
            make_set(out, kitti(raw_root), PREPARE, train="0-1", evaluation="2", workers=1)
        other.communicate()
    make_set(out, kitti(raw_root), PREPARE, train="0-1", evaluation="2", workers=1)
