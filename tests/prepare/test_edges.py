import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from jaxsim.prepare import edge_map


def oracle(ids):
    h, w = ids.shape
    marked = np.zeros((h, w), bool)
    for r in range(h):
        for c in range(w):
            for dr, dc in ((0, 1), (1, 0), (0, -1), (-1, 0)):
                if 0 <= r + dr < h and 0 <= c + dc < w and ids[r, c] != ids[r + dr, c + dc]:
                    marked[r, c] = True
    return marked


LABELS = hnp.arrays(np.int32, (7, 9), elements=st.integers(0, 3))


@given(LABELS, LABELS)
@settings(max_examples=50, deadline=None)
def test_equals_the_difference_of_semantic_times_1000_plus_instance(semantic, instance):
    np.testing.assert_array_equal(edge_map(semantic, instance), oracle(semantic * 1000 + instance))


def test_both_sides_of_a_border_are_marked_and_the_rasters_own_border_is_none():
    semantic = np.zeros((4, 6), np.int32)
    semantic[:, 3:] = 7
    expected = np.zeros((4, 6), bool)
    expected[:, 2:4] = True
    np.testing.assert_array_equal(edge_map(semantic, np.zeros_like(semantic)), expected)


def test_a_thousandth_instance_is_not_the_next_class():
    semantic = np.array([[7, 8]], np.int32)
    assert edge_map(semantic, np.array([[1000, 0]], np.int32)).all()


def test_batches_are_separate():
    ids = np.random.default_rng(0).integers(0, 3, (2, 3, 5, 8)).astype(np.int32)
    both = edge_map(ids, ids)
    for i in range(2):
        for j in range(3):
            np.testing.assert_array_equal(both[i, j], oracle(ids[i, j]))


def test_equals_both_published_programs(golden):
    imaginaire = np.load(golden / "pix2pixhd_imaginaire/input_label_edges.npz")
    ids = imaginaire["instance_ids"][:2]
    np.testing.assert_array_equal(edge_map(np.zeros_like(ids), ids), imaginaire["label"][:, -1])
    original = np.load(golden / "pix2pixhd_original/input_and_edges.npz")
    ids = original["inst"][:, 0]
    np.testing.assert_array_equal(edge_map(np.zeros_like(ids), ids), original["edge"][:, 0])
