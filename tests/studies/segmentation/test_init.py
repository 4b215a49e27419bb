"""The command: its table, the embedded world, and wrong settings."""

import json
import shutil

import numpy as np
import pytest

from jaxsim.cli.real2sim2real import run
from jaxsim.config import GeneratorConfig, SegmentationConfig
from jaxsim.data.logs.range_images import read_range_images
from jaxsim.files import write_text
from jaxsim.studies.segmentation import run_segmentation
from jaxsim.studies.segmentation.study import INTENSITIES


def test_tables_come_from_the_scores_of_all_parts(folder, tmp_path):
    """Without a training: scores that are there are taken."""
    out = tmp_path / "out"
    flags = ["--task", "segmentation", "--root", str(folder), "--out", str(out), "--seeds", "0", "1"]
    values = {"none": [[0, 0, 0], [0, 5, 5], [0, 5, 5]], "simulated": [[0, 0, 0], [0, 8, 2], [0, 2, 8]]}
    values["measured"] = [[0, 0, 0], [0, 10, 0], [0, 0, 10]]
    (out / "scores").mkdir(parents=True)
    for kind, cells in values.items():
        for name in (f"{kind}_part{part}_seed{seed}.json" for part in range(3) for seed in (0, 1)):
            (out / "scores" / name).write_text(json.dumps({"confusion": cells}))
    run(flags)
    text = (out / "segmentation.md").read_text()
    assert "| 0.333 ± 0.000 | 0.667 ± 0.000 | 1.000 ± 0.000 |" in text
    assert "worth +0.667 of mean IoU; simulated intensity 50 % of that" in text
    assert json.loads((out / "segmentation.json").read_text())["worth"] == pytest.approx(0.5)
    with pytest.raises(ValueError, match="steps"):
        run([*flags, "--steps", "5"])


def test_scores_of_images_that_have_changed_since_are_not_taken_for_theirs(folder, tmp_path):
    """The table would say of twelve images what six scored."""
    images = shutil.copytree(folder, tmp_path / "images")
    config = SegmentationConfig(root=images, out=tmp_path / "out")
    for name in (f"{kind}_part{part}_seed0.json" for kind in INTENSITIES for part in range(3)):
        write_text(config.out / "scores" / name, '{"confusion": [[0, 0, 0], [0, 1, 0], [0, 0, 1]]}')
    run_segmentation(config)
    run_segmentation(config)
    shutil.copy(images / "05.npz", images / "06.npz")
    with pytest.raises(ValueError, match=r"images was [0-9a-f]{16}, now .*stamps of the folder's images"):
        run_segmentation(config)


def test_wrong_settings_are_told(folder, tmp_path):
    for words, change in (
        ("give some, and each once", {"seeds": (1, 1)}),
        ("both networks are a unet", {"network": GeneratorConfig()}),
        ("6 images in 2 parts", {"parts": 2}),
        ("6 images in 1 parts; of two parts each", {"parts": 1, "judged": folder}),
        ("--judged was given without --root", {"root": None, "judged": folder}),
        ("half of them judge", {"root": None, "frames": 1}),
        ("6 images in 7 parts", {"parts": 7}),
        ("3 images in 1 parts; of two parts each", {"root": None, "frames": 3, "parts": 1}),
    ):
        with pytest.raises(ValueError, match=words):
            run_segmentation(SegmentationConfig(**({"root": folder, "out": tmp_path} | change)))
    # Nothing was begun: the right settings are not those of another study.
    assert not [*tmp_path.iterdir()]
    with pytest.raises(ValueError, match="no task 'depth'"):
        run(["--task", "depth"])


def test_images_of_another_sensor_are_not_judged(folder, tmp_path):
    other = tmp_path / "other"
    other.mkdir()
    np.savez(other / "0.npz", scan=np.ones((5, 16, 6), np.float32))
    with pytest.raises(ValueError, match="judge frames of the same sensor"):
        run_segmentation(SegmentationConfig(root=folder, judged=other, out=tmp_path / "out"))


def test_images_without_a_label_are_told_before_anything_is_learned(folder, tmp_path):
    (tmp_path / "one").mkdir()
    for k in range(6):
        np.savez(tmp_path / "one" / f"{k}.npz", scan=np.ones((4, 16, 6), np.float32) * [1, 1, 1, 1, 1, 0])
    with pytest.raises(ValueError, match="no cell of the 6 images to learn from has a label"):
        run_segmentation(SegmentationConfig(root=tmp_path / "one", out=tmp_path / "out"))
    with pytest.raises(ValueError, match="no cell of the 6 images to judge has a label"):
        run_segmentation(SegmentationConfig(root=folder, judged=tmp_path / "one", out=tmp_path / "out"))


@pytest.mark.long
def test_the_embedded_world_is_rendered_once_and_its_town_judged(tmp_path, monkeypatch):
    """One street of each place and a network of a few weights: what is shown is the way, not the worth."""
    small = GeneratorConfig(form="unet", filters=2, downsamples=1, blocks=0, enhancers=0)
    config = SegmentationConfig(network=small, frames=2, parts=2, steps=1, sensor_steps=1, columns=16, out=tmp_path)
    table = run_segmentation(config)
    text = table.read_text()
    assert "2 images, and 1 others to judge; 1 seed" in text
    for name in ("road", "marking", "wet road", "vehicle"):
        assert f"| {name} |" in text
    suburb, town = read_range_images(tmp_path / "images/suburb"), read_range_images(tmp_path / "images/town")
    assert (len(suburb), len(town)) == (2, 1)
    # No street of the town is one of the suburb with other traffic: each world has a seed of its own.
    assert {image.name.split("-")[1] for image in suburb}.isdisjoint(image.name.split("-")[1] for image in town)
    assert sorted(path.name for path in (tmp_path / "scores").iterdir()) == sorted(
        f"{kind}_elsewhere_seed0.json" for kind in INTENSITIES
    )
    monkeypatch.setattr("jaxsim.data.synthetic.labelled.labelled_image", lambda *_: pytest.fail("rendered again"))
    assert run_segmentation(config).read_text() == text
