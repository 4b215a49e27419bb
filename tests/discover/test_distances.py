"""Distances of two folders against the plainest computation, and folders that are no two sides."""

import numpy as np
import pytest

from jaxsim.discover.distances import frame_distances, quick_distances
from jaxsim.frame import PolarImage
from tests.discover.made_gate import sides


def test_distances_are_the_plainest_means_over_scenes(tmp_path):
    simulated, measured = sides(tmp_path, scenes=5)
    found = quick_distances(simulated, measured)
    rows = []
    for k in range(5):
        a, b = (np.load(folder / f"{k:03d}.npz") for folder in (simulated, measured))
        both = (a["range"] > 0) & (b["range"] > 0)
        rows.append(
            (
                np.abs(a["intensity"] - b["intensity"])[both].mean(),
                np.median(np.abs(a["range"] - b["range"])[both]),
                ((a["range"] > 0) != (b["range"] > 0)).sum() / (a["range"] > 0).sum(),
            )
        )
    expected = np.array(rows)
    for k, one in enumerate(found.channels.values()):
        assert one.value == pytest.approx(expected[:, k].mean(), rel=1e-5)
        assert one.low < one.value < one.high


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda s, m: (m, m), "hold the same readings"),
        (lambda s, m: (altered(s, range=lambda x: x / 1000), m), "ranges are metres"),
        (lambda s, m: (s, altered(m, intensity=lambda x: 0 * x + 0.5)), "measured intensity is 0.5 everywhere"),
        (lambda s, m: (s, altered(m, incidence=lambda x: 0 * x + 0.5)), "which no sensor knows"),
    ],
)
def test_fast_refuses_what_a_whole_answer_refuses(tmp_path, change, message):
    with pytest.raises(ValueError, match=message):
        quick_distances(*change(*sides(tmp_path)))


def altered(folder, **changes):
    """The folder with arrays of its frames changed; what is not there is made of the ranges."""
    for file in folder.glob("*.npz"):
        arrays = dict(np.load(file))
        given = {name: change(arrays.get(name, arrays["range"])) for name, change in changes.items()}
        np.savez(file, **{**arrays, **given})
    return folder


def test_frames_in_which_neither_side_sees_anything_differ_in_nothing():
    nothing = np.zeros((2, 3), bool)
    image = PolarImage(nothing.astype(np.float32), nothing.astype(np.float32), nothing)
    assert np.isnan(frame_distances(image, image)).all()


@pytest.mark.parametrize("common", [0, 1])
def test_no_more_than_all_rays_are_lost(common):
    def image(valid):
        return PolarImage(20 * valid.astype(np.float32), 0.5 * valid.astype(np.float32), valid)

    ray = np.arange(20).reshape(4, 5)
    intensity, _, drop = frame_distances(image(ray < 5 + common), image(ray >= 5))
    assert drop == 1
    assert np.isnan(intensity) == (not common)
