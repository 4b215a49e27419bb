"""Batches depend on seed and number alone, however many processes share them."""

import jax
import numpy as np
import pytest

from jaxsim.data.batches import Changing, batches, crop, magnified
from jaxsim.frame import Painted, Pair, PolarImage
from jaxsim.train.training import ahead


def pair(i: int) -> Pair:
    """Every raster holds a hundred times the pair's number, ten more in each row and one more in each column."""
    raster = np.float32(100 * i) + 10 * np.arange(4, dtype=np.float32)[:, None] + np.arange(6, dtype=np.float32)
    whole, mask = raster.astype(np.int32), np.ones((4, 6), bool)
    painted = Painted(raster, raster, np.stack([raster] * 3, -1), whole, whole, mask, ~mask)
    return Pair(painted, raster, raster, raster, PolarImage(raster, raster, mask))


PAIRS = [pair(i) for i in range(10)]


def numbers(batch: Pair) -> list[int]:
    return [int(i) for i in batch.target[:, 0].min(-1) // 100]


@pytest.mark.parametrize("parts", [1, 2, 4])
def test_the_parts_of_all_processes_are_the_batch_of_one(parts):
    whole = batches(PAIRS, size=4, seed=3, flip=True)
    shares = [batches(PAIRS, size=4, seed=3, flip=True, part=i, parts=parts) for i in range(parts)]
    for k in (0, 1, 7):
        targets = np.concatenate([share[k].target for share in shares])
        np.testing.assert_array_equal(targets, whole[k].target)


def test_an_epoch_shows_every_pair_once_and_the_next_in_another_order():
    loader = batches(PAIRS, size=5, seed=0)
    epochs = [[*numbers(loader[2 * e]), *numbers(loader[2 * e + 1])] for e in range(2)]
    assert [sorted(epoch) for epoch in epochs] == [list(range(10))] * 2
    assert epochs[0] != epochs[1]


@pytest.mark.parametrize("parts", [1, 2])
def test_batches_read_ahead_are_those_asked_for_one_by_one(parts):
    loader = batches(PAIRS, size=4, seed=3, flip=True, part=parts - 1, parts=parts)
    for start in (0, 5):
        read = [batch.target for batch in ahead(loader, start, 9)]
        assert len(read) == 9 - start
        for k, target in enumerate(read, start):
            np.testing.assert_array_equal(target, loader[k].target)


def test_what_spoils_a_batch_that_is_read_ahead_is_told():
    def damaged(batch):
        raise ValueError("record 7 is damaged")

    with pytest.raises(ValueError, match="record 7 is damaged"):
        next(ahead(batches(PAIRS, size=4, seed=3).map(damaged), 0, 2))


def test_a_batch_that_cannot_be_filled_or_divided_is_refused():
    with pytest.raises(ValueError, match=r"10 training frames cannot fill a batch of 11; lower --optim\.batch"):
        batches(PAIRS, size=11, seed=0)
    with pytest.raises(ValueError, match=r"4 frames cannot be divided among 3 processes"):
        batches(PAIRS, size=4, seed=0, parts=3)


def test_a_magnified_pair_shows_a_part_of_it_cell_for_cell():
    target = np.arange(24, dtype=np.float32).reshape(4, 6)
    source = PAIRS[0].replace(target=target)
    np.testing.assert_array_equal(magnified(source, 1.0, (0.5, 0.5), size=(4, 6)).target, target)
    twice = target.repeat(2, 0).repeat(2, 1)
    np.testing.assert_array_equal(magnified(source, 2.0, (0.0, 0.0), size=(4, 6)).target, twice[:4, :6])
    np.testing.assert_array_equal(magnified(source, 2.0, (0.999, 0.999), size=(4, 6)).target, twice[4:, 6:])


def test_magnification_is_drawn_for_every_pair_and_every_epoch():
    """Brightest cell of a row less the darkest: the window's width in columns, less one."""
    loader = batches(PAIRS, size=10, seed=5, scale_limit=1.0, raster=(8, 60))
    first, second = (np.ptp(loader[k].target[:, 0] % 10, axis=1) for k in (0, 1))
    assert {first.min(), first.max()} <= {2, 3, 4, 5}
    assert len(set(first)) > 1
    assert not np.array_equal(first, second)
    again = batches(PAIRS, size=10, seed=5, scale_limit=1.0, raster=(8, 60))
    np.testing.assert_array_equal(loader[1].target, again[1].target)


def test_pairs_of_other_windows_come_at_one_size():
    tall = jax.tree.map(lambda raster: np.concatenate([raster, raster[-1:]]), PAIRS[1])
    loader = batches([PAIRS[0], tall], size=2, seed=0, raster=(8, 12))
    assert loader[0].target.shape == (2, 8, 12)
    assert sorted(numbers(loader[0])) == [0, 1]


def test_magnifying_needs_a_size_to_cut_out():
    with pytest.raises(ValueError, match="raster must say"):
        batches(PAIRS, size=2, seed=0, scale_limit=0.2)


def test_parts_are_cut_out_of_every_raster_at_one_place():
    rows, columns = PAIRS[0].target.shape
    for place, left in ((0.0, 0), (0.5, 1), (0.999, 2)):
        part = crop(PAIRS[0], (rows - 1, columns - 2), (0.999, place))
        for whole, piece in zip(jax.tree.leaves(PAIRS[0]), jax.tree.leaves(part), strict=True):
            np.testing.assert_array_equal(piece, whole[1:, left : left + columns - 2])


def test_cut_parts_come_from_all_over_the_frame():
    loader = batches(PAIRS[:2], size=2, seed=0, cut=(3, 4))
    corners = np.concatenate([loader[k].target[:, 0, 0] % 100 for k in range(40)])
    assert loader[0].painted.rgb.shape == (2, 3, 4, 3)
    rows, columns = PAIRS[0].target.shape
    assert {*corners} == {10 * row + column for row in range(rows - 2) for column in range(columns - 3)}


def test_batches_change_from_one_loader_to_another_at_a_number():
    first, then = batches(PAIRS, size=4, seed=3), batches(PAIRS[:4], size=4, seed=3)
    loader = Changing(first, then, at=5)
    for k, expected in ((0, first), (4, first), (5, then), (9, then)):
        np.testing.assert_array_equal(loader[k].target, expected[k].target)
    assert [sorted(numbers(batch)) == [0, 1, 2, 3] for batch in ahead(loader, 4, 7)] == [False, True, True]
