"""One claim for every command's folder."""

import json
from dataclasses import dataclass, replace

import pytest

from jaxsim.files import claim, claim_settings


def claimed(folder, made, **settings):
    claim(folder / "made.json", made, by="bake", text=json.dumps(made), **settings)


def test_the_first_to_come_claims_a_folder_and_the_same_settings_go_on(tmp_path):
    claimed(tmp_path, {"oven": {"heat": 200}})
    claimed(tmp_path, {"oven": {"heat": 200}})
    assert json.loads((tmp_path / "made.json").read_text()) == {"oven": {"heat": 200}}
    assert [path.name for path in tmp_path.iterdir()] == ["made.json"]


def test_other_settings_are_refused_by_name_and_the_record_stays(tmp_path):
    claimed(tmp_path, {"oven": {"heat": 200}, "salt": 1})
    message = r"^bake: .* was made with other settings \(oven\.heat was 200, now 180; flour was None, now rye\); give "
    with pytest.raises(ValueError, match=message + "another --out, or delete the folder$"):
        claimed(tmp_path, {"oven": {"heat": 180}, "salt": 1, "flour": "rye"})
    assert json.loads((tmp_path / "made.json").read_text()) == {"oven": {"heat": 200}, "salt": 1}


def test_what_is_free_may_differ_and_is_named_where_something_else_does(tmp_path):
    claimed(tmp_path, {"oven": {"heat": 200}, "salt": 1})
    claimed(tmp_path, {"oven": {"heat": 180}, "salt": 1}, free=["oven"])
    with pytest.raises(ValueError, match=r"salt was 1, now 2\); .*free to change are oven"):
        claimed(tmp_path, {"oven": {"heat": 160}, "salt": 2}, free=["oven"])


def test_a_folder_without_results_may_change_its_settings(tmp_path):
    claimed(tmp_path, {"salt": 1})
    claimed(tmp_path, {"salt": 2}, filled=False)
    assert json.loads((tmp_path / "made.json").read_text()) == {"salt": 2}


def test_results_without_a_record_are_refused_unless_that_says_something(tmp_path):
    with pytest.raises(ValueError, match=r"not empty, and no made\.json says"):
        claimed(tmp_path, {"salt": 1}, filled=True)
    with pytest.raises(ValueError, match=r"salt was 0, now 1"):
        claimed(tmp_path, {"salt": 1}, filled=True, unsaid={"salt": 0})
    claimed(tmp_path, {"salt": 0}, filled=True, unsaid={"salt": 0})


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("{", "Expecting property"),
        ("[]", "a value is of another kind"),
        ('{"other": 1}', "lacks 'made'"),
    ],
)
def test_a_damaged_record_says_so(tmp_path, text, told):
    (tmp_path / "made.json").write_text(text)
    with pytest.raises(ValueError, match=rf"made\.json cannot be read \([^()]*{told}.*\); copy it again; or give"):
        claimed(tmp_path, {"salt": 1}, read=lambda record: json.loads(record)["made"])


def test_a_record_that_was_lost_is_named_once(tmp_path):
    (tmp_path / "made.json").write_bytes(bytes(20))
    with pytest.raises(
        ValueError, match=r"^bake: [^(]*made\.json, line 1: 20 of 20 bytes are 0, [^(]*; or give another"
    ):
        claimed(tmp_path, {"salt": 1})


def test_a_folder_that_moved_and_a_long_list_are_told_in_words(tmp_path):
    claimed(tmp_path, {"clouds": "/a", "frames": list(range(20))})
    with pytest.raises(ValueError, match=r"only moved, write its new path into made\.json"):
        claimed(tmp_path, {"clouds": "/b", "frames": list(range(20))})
    with pytest.raises(ValueError, match=r"frames was 20 values \(0 \.\.\. 19\), now \[0\]"):
        claimed(tmp_path, {"clouds": "/a", "frames": [0]})


def test_a_setting_that_was_empty_is_told_as_such(tmp_path):
    claimed(tmp_path, {"sensor": ""})
    with pytest.raises(ValueError, match=r"\(sensor was empty, now hdl64e\)"):
        claimed(tmp_path, {"sensor": "hdl64e"})


@dataclass(frozen=True)
class Oven:
    heat: int = 200
    racks: tuple[int, ...] = (1, 2)


def test_a_dataclass_of_settings_claims_a_folder_and_comes_back_from_its_record(tmp_path):
    record = tmp_path / "oven.json"
    claim_settings(record, Oven(), by="bake", free=["racks"])
    claim_settings(record, Oven(racks=(3,)), by="bake", free=["racks"])
    assert json.loads(record.read_text()) == {"heat": 200, "racks": [3]}
    with pytest.raises(ValueError, match=r"^bake: .*heat was 200, now 180\);.*free to change are racks"):
        claim_settings(record, replace(Oven(), heat=180), by="bake", free=["racks"])
    record.write_text('{"heat": "hot"}')
    with pytest.raises(ValueError, match=r"oven\.json cannot be read"):
        claim_settings(record, Oven(), by="bake")
