"""Numbers out of their range are refused wherever they come from."""

import re
from dataclasses import replace
from pathlib import Path

import pytest

from jaxsim.cli import main
from jaxsim.config import DataConfig, DetectorExperiment, Experiment, OptimConfig, PrepareConfig, RunConfig
from jaxsim.config.ranges import settings_of


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("simulate RUN --out OUT --batch -3", "batch .* is -3; it must be 1 or more"),
        ("simulate RUN --out OUT --batch 0", "batch .* is 0; it must be 1 or more"),
        ("export --out OUT --workers 0", "workers .* is 0; it must be 1 or more"),
        ("export --out OUT --filled 2 0.5", "filled .* it must be 0 or more and 1 or less, each"),
        ("prepare synthetic --out OUT --pairs-a-file 0", "pairs-a-file .* is 0"),
        ("detect RUN --clouds C --out OUT --pictures -1", "pictures .* is -1; it must be 0 or more"),
        ("discover RUN --out OUT --nulls -1", "nulls .* is -1"),
        ("train demo --optim.lr nan", "lr .* is nan; it must be a finite number"),
        ("train demo --optim.betas 1 0.9", "betas .* it must be 0 or more and below 1, each"),
        ("frames LOG --log.columns 1", "columns .* is 1; it must be 2 or more and 65536 or less"),
        ("prepare synthetic --out OUT --prepare.columns 1", "columns .* is 1; it must be 2 or more and 65536 or less"),
        ("train demo --prepare.network-size 0 64", r"network-size .* is \(0, 64\); it must be 1 or more, each"),
        ("train demo --prepare.max-range-m 0", "max-range-m .* is 0.0; it must be above 0"),
        ("train demo --run.keep 0", "keep .* is 0; it must be 1 or more"),
    ],
)
def test_a_flag_out_of_its_range_is_refused_by_its_name(tmp_path, monkeypatch, capsys, words, message):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as stop:
        main(words.split())
    said = " ".join(f"{stop.value.code} {capsys.readouterr()}".replace("│", " ").replace("\\n", " ").split())
    assert re.search(message, said), said
    assert not [*tmp_path.iterdir()]


@pytest.mark.parametrize(
    "make",
    [
        lambda: OptimConfig(batch=0),
        lambda: OptimConfig(betas=(0.5, 1.5)),
        lambda: OptimConfig(lr=float("inf")),
        lambda: RunConfig(save_every=-1),
        lambda: PrepareConfig(image_crop=(352, -1)),
        lambda: replace(Experiment().generator, filters=0),
        lambda: PrepareConfig(image_crop=(352,)),
        lambda: OptimConfig(steps=10**400),
        lambda: OptimConfig(steps="9"),
        lambda: OptimConfig(batch=True),
        lambda: OptimConfig(flip=1),
        lambda: DataConfig(kind="kitty"),
        lambda: DataConfig(root=3),
        lambda: Experiment(data={"kind": "synthetic"}),
        lambda: PrepareConfig(inputs="rgb"),
        lambda: PrepareConfig(network_size=64),
        lambda: DataConfig(scenes="0001"),
        lambda: OptimConfig(start="generator.npz"),
    ],
)
def test_so_is_a_value_in_python(make):
    with pytest.raises(ValueError, match="it must be"):
        make()


def test_a_path_may_be_text_and_a_tuple_a_list():
    data = DataConfig(root="drives", cache="kept")
    assert (data.root, data.cache) == (Path("drives"), Path("kept"))
    listed, settings = PrepareConfig(inputs=["rgb", "row"]), PrepareConfig(inputs=("rgb", "row"))
    assert (listed, hash(listed)) == (settings, hash(settings))


def test_settings_are_named_by_their_role():
    assert [*settings_of(DataConfig, "chosen", "kept")] == ["train", "validation", "cache"]
    assert [*settings_of(PrepareConfig, "weights")] == ["depth_weights", "denoise_weights"]
    assert [*settings_of(Experiment, "used", "drawn")] == ["generator.widen", "generator.looks", "run.seed"]
    assert not [*settings_of(DetectorExperiment, "lasts")]


def test_a_setting_with_a_role_is_of_its_type_like_any_other():
    assert DataConfig(scenes=["0001"]).scenes == ("0001",)
    with pytest.raises(ValueError, match=r"keep .* must be 1 or more"):
        RunConfig(keep=0)
