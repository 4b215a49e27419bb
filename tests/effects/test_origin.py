"""Where effects come from."""

import hashlib
import json

import pytest

from jaxsim.effects import EFFECTS
from jaxsim.effects.chain import SensorModel
from jaxsim.effects.own import known_effects
from tests.effects.own import forgetful, text_of, write  # noqa: F401  (a fixture)

pytestmark = pytest.mark.usefixtures("forgetful")


def test_an_effect_goes_through_its_sensor_json_with_where_it_comes_from(tmp_path):
    path = write(tmp_path)
    known_effects([path])
    model = SensorModel((("vignetting", {"share": 0.5}), ("beam_gain", {"gain": 0.1})))
    model.save(tmp_path / "sensor.json")
    entries = json.loads((tmp_path / "sensor.json").read_text())["effects"]
    sha256 = hashlib.sha256(path.read_bytes()).hexdigest()
    assert [entry.get("from") for entry in entries] == [None, {"file": "vignetting.py", "sha256": sha256}]
    assert SensorModel.load(tmp_path / "sensor.json") == model
    # Folders of frames and trees say so, too, for a file of the same name may have been edited.
    assert model.optional()["own"] == {"vignetting": {"file": "vignetting.py", "sha256": sha256}}


def test_a_sensor_json_loads_no_code_and_says_what_is_needed(tmp_path, monkeypatch):
    known_effects([write(tmp_path)])
    SensorModel((("vignetting", {"share": 0.5}),)).save(tmp_path / "sensor.json")
    del EFFECTS["vignetting"]
    monkeypatch.chdir(tmp_path)  # the file lies beside it, and is left alone
    with pytest.raises(ValueError, match=r"not there; give the file .* --effects-from vignetting.py: its code is run"):
        SensorModel.load(tmp_path / "sensor.json")
    known_effects([write(tmp_path, parameter='Parameter(0.0, 0.0, 2.0, "", "another", scale=0.3)')])
    with pytest.raises(ValueError, match="may not be the same formula; give the file that it was found with"):
        SensorModel.load(tmp_path / "sensor.json")
    for said, words in (({"package": "acme", "version": "3"}, "install the package .* acme 3"), ("x", '"from" is')):
        entry = {"name": "other", "from": said}
        (tmp_path / "sensor.json").write_text(json.dumps({"effects": [entry]}))
        with pytest.raises(ValueError, match=words):
            SensorModel.load(tmp_path / "sensor.json")
    (tmp_path / "sensor.json").write_text('{"effects": [{"name": "other"}]}')
    with pytest.raises(ValueError, match=r"no effect named 'other'.* --effects-from FILE.py, or its package"):
        SensorModel.load(tmp_path / "sensor.json")
