"""Range images of the embedded world: what each class is, and how bright."""

import numpy as np
import pytest

from jaxsim.data.cityscapes import IDS
from jaxsim.data.logs.range_images import read_range_images
from jaxsim.data.synthetic import SyntheticWorld
from jaxsim.data.synthetic.labelled import LABEL_CLASSES, OF_MATERIAL, classes_of, labelled_image, write_labelled
from jaxsim.data.synthetic.render import IdealScan
from jaxsim.geometry import preset


@pytest.fixture(scope="module")
def world() -> SyntheticWorld:
    return SyntheticWorld(5, preset("hdl64e"), 512, streets="wet_town")


@pytest.fixture(scope="module")
def image(world):
    return labelled_image(world, 4)


def test_each_material_has_a_class_of_its_own():
    kinds = {
        "road": ("road", ()),
        "wet road": ("road", ("wet",)),
        "marking": ("road", ("marking", "wet")),
        "vehicle": ("car", ()),
        "number plate": ("car", ("retro",)),
        "sign": ("traffic sign", ()),
        "sign's sheet": ("traffic sign", ("retro",)),
        "unlabelled": ("sky", ()),
    }
    flags = {
        name: np.array([[name in marks for _, marks in kinds.values()]])
        for name in ("wet", "marking", "retro", "glass", "absorbing")
    }
    size = (1, len(kinds))
    scan = IdealScan(
        range_m=np.full(size, 9, np.float32),
        valid=np.array([[name != "sky" for name, _ in kinds.values()]]),
        incidence_rad=np.zeros(size, np.float32),
        reflectance=np.ones(size, np.float32),
        semantic=np.array([[IDS[name] for name, _ in kinds.values()]]),
        instance=np.zeros(size, np.int32),
        **flags,
    )
    assert [LABEL_CLASSES[number] for number in classes_of(scan)[0]] == list(kinds)


@pytest.mark.long
def test_classes_of_material_lie_on_what_they_are_part_of(world):
    truth = world.truth(4)
    label = classes_of(truth.scan)
    semantic = np.asarray(truth.scan.semantic)
    for name, kinds in (("marking", {7}), ("wet road", {7}), ("number plate", {26, 27, 28}), ("sign's sheet", {20})):
        met = semantic[label == LABEL_CLASSES.index(name)]
        assert {*np.unique(met)} <= kinds, name
    for name in ("wet road", "marking", "number plate"):
        assert (label == LABEL_CLASSES.index(name)).any(), name
    assert not label[~np.asarray(truth.scan.valid)].any()
    assert (label[np.asarray(truth.scan.valid)] > 0).mean() > 0.99


def test_classes_of_material_differ_in_brightness(image):
    label, intensity = image[..., 5], image[..., 3]
    mean = {name: intensity[label == LABEL_CLASSES.index(name)].mean() for name in ("road", "wet road", "marking")}
    assert mean["wet road"] < 0.7 * mean["road"]
    assert mean["marking"] > 1.3 * mean["road"]


def test_a_cell_holds_its_point(image):
    valid = image[..., 4] > 0
    away = np.linalg.norm(image[..., :3], axis=-1)
    # Beams start a few centimetres above one another.
    assert np.abs(away - image[..., 4])[valid].max() < 0.15
    assert not image[~valid].any()


def test_files_are_read_as_labelled_range_images(tmp_path, world, image, monkeypatch):
    write_labelled(tmp_path, world, [4])
    (read,) = read_range_images(tmp_path)
    np.testing.assert_array_equal(read.label, image[..., 5])
    np.testing.assert_allclose(read.intensity, image[..., 3])
    monkeypatch.setattr("jaxsim.data.synthetic.labelled.labelled_image", lambda *_: pytest.fail("rendered again"))
    write_labelled(tmp_path, world, [4])


def test_every_class_has_a_name_of_its_own():
    assert len({*LABEL_CLASSES}) == len(LABEL_CLASSES)
    assert {*OF_MATERIAL} < {*LABEL_CLASSES}
