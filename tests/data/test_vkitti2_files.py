"""Virtual KITTI 2's file formats."""

import numpy as np
import pytest
from PIL import Image

from jaxsim.data.cityscapes import IDS
from jaxsim.data.vkitti2 import LENGTHS, VARIATIONS
from jaxsim.data.vkitti2_files import CITYSCAPES_OF, COLOURS, boxes_of, read_indexed, read_objects
from tests.data.virtual_drives import CLASS_OF


def test_the_published_facts():
    assert sum(LENGTHS.values()) == 2126
    assert len(VARIATIONS) == 10
    assert set(COLOURS) == set(CITYSCAPES_OF)
    assert len(set(COLOURS.values())) == 15
    assert set(CITYSCAPES_OF.values()) <= set(IDS)


def test_published_rows_are_read_as_they_mean(virtual_root):
    folder = virtual_root / "Scene01/clone"

    def keep(name: str, *rows: str) -> None:
        header = (folder / f"{name}.txt").read_text().splitlines()[0]
        (folder / f"{name}.txt").write_text("\n".join([header, *rows]) + "\n")

    keep("info", "0 Van Multi5 Grey")
    keep("bbox", "25 0 0 988 1241 159 374 41767 0.4230517 0.7678463 False")
    keep(
        "pose",
        "25 0 0 1.69414 1.776562 1.421875 3.617188 53.18796 -106 79.85496 2.263542 0 0 "
        "-3.088518 1.056862 55.55215 1.638601 -0.01539355 0.03731001",
    )
    (thing,) = read_objects(folder)[25, 0]
    assert (thing.kind, thing.track, thing.pixels) == ("Van", 0, 41767)
    assert thing.bbox_px == (988, 159, 1241, 374)
    assert thing.size_m == (3.617188, 1.776562, 1.421875)
    assert thing.centre_m == (-3.088518, 1.056862, 55.55215)
    assert thing.occupancy == pytest.approx(41767 / ((1241 - 988) * (374 - 159)), abs=1e-6)
    boxes = boxes_of([thing])
    np.testing.assert_array_equal(boxes.occluded, [1])
    np.testing.assert_array_equal(boxes_of([thing], levels=(0.9, 0.8)).occluded, [3])
    np.testing.assert_allclose(boxes.bbox_px, [[988, 159, 1241, 374]])


@pytest.mark.parametrize("bits", [1, 2, 4, 8])
def test_indices_of_a_palette_are_read_at_every_depth(tmp_path, bits):
    numbers = np.random.default_rng(bits).integers(0, 2**bits, (7, 13)).astype(np.uint8)
    image = Image.fromarray(numbers)
    image.putpalette([0] * 768)  # colours that do not tell the indices apart
    image.save(tmp_path / "a.png", bits=bits)
    np.testing.assert_array_equal(read_indexed(tmp_path / "a.png"), numbers)
    Image.fromarray(numbers).save(tmp_path / "grey.png")
    np.testing.assert_array_equal(read_indexed(tmp_path / "grey.png"), numbers)
    (tmp_path / "a.png").write_bytes((tmp_path / "a.png").read_bytes()[:60])
    with pytest.raises(ValueError, match="it is cut off"):
        read_indexed(tmp_path / "a.png")


def test_classes_that_the_world_draws_are_classes_of_the_set():
    assert set(CLASS_OF.values()) <= set(COLOURS)
