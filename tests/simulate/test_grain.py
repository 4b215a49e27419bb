"""Draws whose cells scatter together: each cell's own distribution stays, and what is beside it is as it was made."""

import json
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import binom, norm

from jaxsim.config import QUANTILES
from jaxsim.simulate.grain import (
    BROKEN_M,
    FILE,
    Field,
    Grain,
    Ranks,
    breaks_of,
    draw_ranks,
    drawn_of,
    ranks_of_fields,
    read_grain,
    save_grain,
)
from jaxsim.simulate.predict import Prediction, drawn
from tests.simulate.made_grain import SHAPE, beside, by_loops, painted, ranges

GRAIN = Grain(
    (Field(0.2), Field(0.1, None, None), Field(0.4, 8, 4, 0.05), Field(0.3, 30, 10)),
    (Field(0.1), Field(0.9, 16, 16, 0.5)),
    ("drive_1",),
)
SMALL = (6, 20)


def small_view():
    """A wall behind a post, with a class of its own, a hole without a range, and a corner."""
    range_m = np.full(SMALL, 12, np.float32) + np.arange(SMALL[0], dtype=np.float32)[:, None]
    range_m[:, 8:10] = 4
    semantic, valid = np.zeros(SMALL, np.int32), np.ones(SMALL, bool)
    semantic[:, 8:10], valid[2:4, 14:16] = 17, False
    return painted(np.where(valid, range_m, np.float32(0)), semantic=semantic, valid=valid)


def test_each_cells_own_quantiles_and_drops_stay_exactly_as_they_were_told():
    """Over independent draws a cell's count is binomial: no cell of any draw may lie beyond what chance allows."""
    draws, view, random = 1500, small_view(), np.random.default_rng(0)
    # Between the sensor's steps of 1/100, so that rounding takes nothing across.
    told = 0.105 + 0.01 * np.sort(random.choice(np.arange(70), (*SMALL, len(QUANTILES)), replace=True), -1)
    told = (told + 0.02 * np.arange(len(QUANTILES))).astype(np.float32)
    share = random.uniform(0.02, 0.9, SMALL).astype(np.float32)
    says = Prediction(jnp.asarray(told[..., 2]), jnp.asarray(share > 0.5), jnp.asarray(told), jnp.asarray(share))

    @jax.jit
    def draw(key):
        ranks = draw_ranks(GRAIN, view, key)
        return drawn(says, key, ranks), drawn(replace(says, drop_share=0 * says.drop_share), key, ranks)

    reported, whole = map(np.asarray, jax.vmap(draw)(jax.random.split(jax.random.key(3), draws)))
    chance = 1e-4 / share.size
    for level, count in [
        (share, (reported == 0).sum(0)),
        *((q, (whole < told[..., k]).sum(0)) for k, q in enumerate(QUANTILES)),
    ]:
        assert (count >= binom.ppf(chance, draws, level)).all()
        assert (count <= binom.isf(chance, draws, level)).all()


@pytest.mark.parametrize(("columns", "rows"), [(2.0, 1.0), (16.0, 4.0)])
def test_a_field_is_as_alike_as_one_that_was_made_cell_by_cell(columns, rows):
    view = painted(ranges())
    on = breaks_of(view.range_m, view.valid, kind=view.semantic, thing=view.instance)
    field = Field(1.0, columns, rows)
    ours = np.stack([drawn_of(field, on, key) for key in jax.random.split(jax.random.key(0), 60)])
    theirs = np.stack([by_loops(np.random.default_rng(k), columns=columns, rows=rows) for k in range(60)])
    for lag in (1, 3, 8):
        for axis, length in ((2, columns), (1, rows)):
            found = beside(ours, lag, axis)
            assert found == pytest.approx(np.exp(-lag / length), abs=0.04)
            assert found == pytest.approx(beside(theirs, lag, axis), abs=0.05)


def test_a_field_breaks_where_the_surface_the_class_or_the_object_ends():
    columns = SHAPE[1]
    far, plane, kind = painted(ranges(wall=60)), painted(ranges()), np.zeros(SHAPE, np.int32)
    kind[:, 60:] = 8
    nothing = 0 * kind
    for view, of_kind, thing, edge in (
        (far, nothing, nothing, 0.5),
        (plane, kind, nothing, None),
        (plane, nothing, kind, None),
    ):
        on = breaks_of(view.range_m, view.valid, kind=of_kind, thing=thing)
        keys = jax.random.split(jax.random.key(1), 100)
        z = np.stack([drawn_of(Field(1.0, 64, 64, edge), on, key) for key in keys])
        across = np.corrcoef(z[:, :, 59].ravel(), z[:, :, 60].ravel())[0, 1]
        assert abs(across) < 0.15  # of 100 draws, whose rows are nearly one
        assert beside(z[:, :, :60], 1, 2) > 0.95
        assert beside(z[:, :, 60:columns], 1, 2) > 0.95


def test_a_field_that_heeds_no_edges_goes_on_across_them():
    view = painted(ranges(wall=60))
    on = breaks_of(view.range_m, view.valid, kind=view.semantic, thing=view.instance)
    z = np.stack([drawn_of(Field(1.0, 64, 64), on, key) for key in jax.random.split(jax.random.key(1), 50)])
    assert np.corrcoef(z[:, :, 59].ravel(), z[:, :, 60].ravel())[0, 1] > 0.95


def test_planes_do_not_bend_edges_do_and_cells_without_a_range_break():
    view = painted(ranges(wall=60))
    valid = view.valid.copy()
    valid[5, 30] = False
    on = breaks_of(view.range_m, valid, kind=view.semantic, thing=view.instance)
    across = np.asarray(on.across_m)
    assert across[6, 1:60].max() < 0.005
    assert across[6, 60] > 1
    assert across[5, 30] == across[5, 31] == BROKEN_M
    assert (across[:, 0] == BROKEN_M).all()
    assert np.asarray(on.down_m)[8:, 1:59].max() < 0.005
    assert not np.asarray(on.new_across)[:, 1:].any()


def test_two_cells_alone_bend_by_their_step():
    valid = np.zeros((1, 6), bool)
    valid[0, 2:4] = True
    range_m = np.array([[9, 9, 10, 12, 9, 9]], np.float32)
    nothing = np.zeros((1, 6), np.int32)
    assert float(breaks_of(range_m, valid, kind=nothing, thing=nothing).across_m[0, 3]) == pytest.approx(2, rel=1e-5)


def test_what_a_class_shares_is_shared_by_the_class_alone():
    view = small_view()
    on = breaks_of(view.range_m, view.valid, kind=view.semantic, thing=view.instance)
    z = np.asarray(drawn_of(Field(1.0, None, None), on, jax.random.key(0)))
    post = np.asarray(view.semantic) == 17
    assert len(np.unique(z[post])) == len(np.unique(z[~post])) == 1
    assert z[post][0] != z[~post][0]


def test_a_seed_draws_the_same_another_seed_other_and_a_batch_what_each_draws():
    one, keys = small_view(), jax.random.split(jax.random.key(5), 3)
    three = jax.tree.map(lambda x: jnp.stack([x] * 3), one)
    batch = jax.jit(lambda view, key: draw_ranks(GRAIN, view, key))(three, keys)
    for k in range(3):
        single = draw_ranks(GRAIN, one, keys[k])
        np.testing.assert_allclose(batch.intensity[k], single.intensity, atol=1e-5)
        np.testing.assert_allclose(batch.drop[k], single.drop, atol=1e-5)
    assert np.abs(batch.intensity[0] - batch.intensity[1]).max() > 0.1
    assert np.abs(batch.intensity[0] - batch.drop[0]).max() > 0.1


def test_another_scan_of_surfaces_that_stay_renews_what_is_each_cells_alone():
    view, stays = painted(ranges()), jax.random.key(7)
    pairs = [
        norm.ppf([draw_ranks(GRAIN, view, jax.random.key(k), stays=jax.random.fold_in(stays, k // 2)).intensity])[0]
        for k in range(40)
    ]
    a, b = np.stack(pairs[::2]), np.stack(pairs[1::2])
    assert np.mean(a * b) / np.mean(a * a) == pytest.approx(0.8, abs=0.06)


def test_shares_of_a_file_that_miss_one_by_a_digit_give_even_ranks():
    view = painted(ranges())
    on = breaks_of(view.range_m, view.valid, kind=view.semantic, thing=view.instance)
    fields = (Field(0.4995),) * 2
    u = np.stack([ranks_of_fields(fields, on, key) for key in jax.random.split(jax.random.key(0), 30)])
    assert np.var(norm.ppf(u)) == pytest.approx(1, abs=0.02)


def test_a_grain_is_read_as_it_was_written(tmp_path):
    assert save_grain(tmp_path, GRAIN) == tmp_path / FILE
    assert read_grain(tmp_path) == GRAIN
    assert GRAIN.fingerprint == read_grain(tmp_path).fingerprint != replace(GRAIN, drop=(Field(1.0),)).fingerprint


def test_a_run_without_a_grain_is_told_both_ways_out(tmp_path):
    with pytest.raises(ValueError, match=r"has no grain\.json.*jaxsim grain .*or draw each cell for itself \(--no-gr"):
        read_grain(tmp_path)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda x: x["drop"].pop(), "shares of drop sum to 0.1"),
        (lambda x: x["intensity"][0].update(share=1.5), "share"),
        (lambda x: x["intensity"][2].update(columns=-3.0), "columns"),
        (lambda x: x["intensity"][2].update(columns=None), "all cells of a class are one in both"),
        (lambda x: x["intensity"][2].update(edge_m=0.0), "edge_m"),
        (lambda x: x["intensity"][0].update(width=2.0), "width"),
        (lambda x: x.pop("drop"), "drop"),
        (lambda x: x.update(drop="white"), "drop"),
    ],
)
def test_a_file_that_is_no_grain_is_refused_with_what_to_do(tmp_path, change, words):
    content = json.loads(save_grain(tmp_path, GRAIN).read_text())
    change(content)
    (tmp_path / FILE).write_text(json.dumps(content))
    with pytest.raises(
        ValueError, match=rf"(?s)grain\.json is no run's grain.*{words}.*learn it anew: jaxsim grain RUN"
    ):
        read_grain(tmp_path)
    (tmp_path / FILE).write_text("{")
    with pytest.raises(ValueError, match=r"grain\.json"):
        read_grain(tmp_path)


def test_ranks_are_of_the_form_that_draws_take():
    assert isinstance(draw_ranks(GRAIN, small_view(), jax.random.key(0)), Ranks)
