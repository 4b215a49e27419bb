"""A prepared set is a stranger's: nothing of it is run, and its names lead nowhere."""

import json
import sys
from pathlib import Path

import pytest

from jaxsim.config import DataConfig, PrepareConfig
from jaxsim.data import open_dataset
from jaxsim.pairs.sets import make_set

PREPARE = PrepareConfig(inputs=("rgb", "depth", "row"), depth="ip_basic_fast", columns=64)


@pytest.fixture
def folder(raw_root, tmp_path) -> Path:
    data = DataConfig(kind="kitti_raw", root=raw_root)
    return make_set(tmp_path / "out", data, PREPARE, train="0-1", workers=1)


def opened(folder: Path):
    return open_dataset(DataConfig(kind="prepared", root=folder))


def test_a_class_that_features_json_names_is_not_imported(folder, tmp_path, monkeypatch):
    """The attack: TFDS imports the module, and importing runs it."""
    mark = tmp_path / "ran"
    (tmp_path / "evil.py").write_text(f"open({str(mark)!r}, 'w')\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    path = folder / "features.json"
    whole = path.read_text()
    opened(folder)
    for name in ("evil.Features", "os.system", "subprocess.Popen"):
        content = json.loads(whole)
        content["pythonClassName"] = name
        path.write_text(json.dumps(content))
        with pytest.raises(ValueError, match=r"features\.json does not describe the pairs .*nothing of it is read"):
            opened(folder)
    assert not mark.exists()
    assert "evil" not in sys.modules
    path.write_text(whole)
    assert len(opened(folder)) == 3


@pytest.mark.parametrize("name", ["/x/y", "../../y", ".."])
def test_a_frames_name_that_would_leave_the_folder_is_refused(folder, name):
    path = folder / "metadata.json"
    content = json.loads(path.read_text())
    content["splits"]["train"]["names"][0] = name
    path.write_text(json.dumps(content))
    with pytest.raises(ValueError, match="came as a frame's name and would become a file's"):
        opened(folder)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda about: about["files"].update({"../x": 1}), "would become a file's"),
        (lambda about: about["splits"].update({"../x": about["splits"]["train"]}), "would become a file's"),
        (lambda about: about["splits"]["train"]["names"].pop(), "differ in length"),
        (lambda about: about["splits"]["train"]["positions"].__setitem__(0, 99), "positions beyond 0..2"),
        (lambda about: about["splits"]["train"].update(name=[]), "did you mean names"),
        (lambda about: about.update(length="3"), "valid integer"),
        (lambda about: about["settings"].pop("data"), "do not name the data set"),
        (lambda about: about["settings"].update(data=None), "settings.data"),
    ],
)
def test_metadata_that_contradicts_itself_is_refused(folder, change, message):
    path = folder / "metadata.json"
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content))
    with pytest.raises(ValueError, match=message):
        opened(folder)
