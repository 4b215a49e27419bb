"""What repeats is found at its scale, with its place, period and size; what does not is not."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from jaxsim.discover.repeats.find import find_repeats, of_maps, of_patterns, scatter
from jaxsim.discover.repeats.maps import Maps
from jaxsim.discover.scenes import signs_of
from tests.discover.repeats.made import COLUMN, COLUMNS, FINDING, ROW, ROWS, maps

RNG = np.random.default_rng(5)
WAVES = [
    (0.4 * np.cos(2 * np.pi * 11 * COLUMN / COLUMNS + 1), "column", COLUMNS / 11, 0.4),
    (0.4 * np.cos(2 * np.pi * 3.5 * ROW / ROWS), "row", ROWS / 3.5, 0.4),
    (0.4 * np.cos(2 * np.pi * (3 * ROW / ROWS + 5 * COLUMN / COLUMNS)), "row x column", COLUMNS / 5, 0.4),
]
PARITIES = [(0.8 * (number % 2 - 0.5), along) for number, along in ((ROW, "row"), (COLUMN, "column"))]
PARITIES.append((0.8 * ((ROW + COLUMN) % 2 - 0.5), "row x column"))
PLACES = [
    (1.0 * (ROW == 5), "row", "row 5", 1.0),
    (1.5 * (COLUMN // 3 == 8), "column", "columns 24 to 26", 1.5),
    (3.0 * ((ROW // 4 == 2) & (COLUMN // 3 == 8)), "cell", "rows 8 to 11, columns 24 to 26", 3.0),
]
ANY = [
    (0.5 * RNG.choice([-1.0, 1.0], (ROWS, 1)) + 0 * ROW, "any row", 0.5),
    (0.9 * RNG.choice([-1.0, 1.0], (1, COLUMNS)) + 0 * ROW, "any column", 0.9),
    (1.0 * RNG.choice([-1.0, 1.0], (ROWS, COLUMNS)), "any cell", 1.0),
]


def first(pattern):
    found = find_repeats({"intensity": maps(1, pattern), "range": maps(2)}, FINDING)
    assert found, "nothing was found"
    one = found[0].repeat
    assert one.channel == "intensity"
    assert one.p_value <= 0.02
    return one


@pytest.mark.parametrize(("pattern", "along", "period", "height"), WAVES)
def test_a_wave_is_found_with_its_period_and_size(pattern, along, period, height):
    one = first(pattern)
    assert (one.scale, one.along, one.period) == ("wave", along, pytest.approx(period))
    assert one.size.low < height < one.size.high


@pytest.mark.parametrize(("pattern", "along"), PARITIES)
def test_odd_against_even_is_found_as_parity(pattern, along):
    one = first(pattern)
    assert (one.scale, one.along, one.period) == ("parity", along, 2)
    assert one.size.value == pytest.approx(0.8, abs=0.15)


@pytest.mark.parametrize(("pattern", "scale", "place", "height"), PLACES)
def test_a_place_is_found_where_it_is(pattern, scale, place, height):
    one = first(pattern)
    assert (one.scale, one.place) == (scale, place)
    assert one.size.value == pytest.approx(height, rel=0.25)


@pytest.mark.parametrize(("pattern", "scale", "height"), ANY)
def test_a_pattern_without_a_period_is_found_by_what_maps_have_in_common(pattern, scale, height):
    one = first(pattern)
    assert one.scale == scale
    assert one.size.value == pytest.approx(height, rel=0.25)


def test_a_pattern_of_find_scenes_alone_does_not_hold():
    pattern = np.where(FINDING[:, None, None], 1, -1) * WAVES[0][0]
    assert not find_repeats({"intensity": maps(1, pattern)}, FINDING)


def test_a_pattern_too_small_to_matter_is_not_told():
    # Judged by its size in the channel's unit: the same maps of a hundredth of the noise are as certain.
    tiny = maps(1, WAVES[0][0])
    tiny = type(tiny)(tiny.weight * 1e4, tiny.total * 1e2, lambda pattern: tiny.weight * 1e4 * pattern)
    assert not find_repeats({"intensity": tiny}, FINDING)


def test_a_pattern_that_rounding_may_make_is_not_told():
    made = maps(1, WAVES[1][0])
    assert find_repeats({"range": replace(made, coarse=0.3 + 0.0 * ROW)}, FINDING)
    # It counts where the pattern is: of a row, that row's.
    assert find_repeats({"range": replace(maps(1, PLACES[0][0]), coarse=1.1 * (ROW != 5))}, FINDING)
    assert not find_repeats({"range": replace(made, coarse=0.5 + 0.0 * ROW)}, FINDING)


def test_of_made_nulls_at_most_one_in_fifty_is_answered():
    answered = [bool(find_repeats({"intensity": maps(seed)}, FINDING, rounds=1)) for seed in range(100, 150)]
    assert sum(answered) <= 1


SCENES = 6


def oracle(statistics, spreads, number):
    """Share of all signs of the scenes under which some statistic is as strong as the observed one of that number."""

    def strength(signs, k):
        return abs(sum(sign * statistics[k][s] for s, sign in enumerate(signs))) / spreads[k]

    observed = strength([1] * SCENES, number)
    many = [max(strength(signs, k) for k in range(len(statistics))) for signs in product([1, -1], repeat=SCENES)]
    return sum(one >= observed - 1e-9 for one in many) / len(many)


@pytest.mark.parametrize("kind", [float, complex])
def test_the_probability_of_a_pattern_is_that_of_the_strongest_of_all_signs(kind):
    rng = np.random.default_rng(4)
    sums = rng.normal(size=(SCENES, 7)).astype(kind)
    if kind is complex:
        sums = sums + 1j * rng.normal(size=sums.shape)
    sums[:, 2] += 2
    information = rng.uniform(4, 8, 7)
    usual = scatter(sums, information)
    agreement = of_patterns(sums, information, signs_of(SCENES), usual=usual)
    spreads = [np.sqrt((sum(abs(v) ** 2 for v in sums[:, k]) + usual * information[k]) / 2) for k in range(7)]
    for number in range(7):
        ours = np.mean(agreement.by_chance >= agreement.strength[number] - 1e-9)
        assert ours == pytest.approx(oracle(sums.T, spreads, number))


def test_maps_resemble_each_other_pair_by_pair():
    rng = np.random.default_rng(3)
    sums = rng.normal(size=(SCENES, 40)) + 0.7 * rng.normal(size=40)
    agreement = of_maps(sums, np.full(40, float(SCENES)), signs_of(SCENES))

    def strength(signs):
        pairs = [(s, t) for s in range(SCENES) for t in range(s)]
        products = [sum(sums[s, k] * sums[t, k] for k in range(40)) for s, t in pairs]
        whole = sum(signs[s] * signs[t] * one for (s, t), one in zip(pairs, products, strict=True))
        by_pair = whole / np.sqrt(sum(one**2 for one in products))
        return np.sqrt(2 * max(1 + by_pair * np.sqrt(2 * (SCENES - 1) / SCENES), 0))

    assert agreement.strength[0] == pytest.approx(strength([1] * SCENES))
    many = sorted(strength(signs) for signs in product([1, -1], repeat=SCENES))
    np.testing.assert_allclose(np.sort(agreement.by_chance), many, atol=1e-9)


def test_pairs_of_scenes_all_alike_are_as_strong_as_their_one_pattern():
    sums = np.ones((SCENES, 1)) * np.array([[1.0, 2, 3]])
    pairs = of_maps(sums, np.full(3, 1.0), signs_of(SCENES))
    alone = of_patterns(sums, np.full(3, 1e-9), signs_of(SCENES), usual=0.0)
    np.testing.assert_allclose(pairs.by_chance, alone.by_chance, atol=1e-6)


def test_maps_that_share_nothing_tell_nothing():
    agreement = of_maps(np.eye(SCENES), np.ones(SCENES), signs_of(SCENES))
    assert agreement.strength[0] == 0
    assert not agreement.by_chance.any()


@pytest.mark.parametrize(("rows", "columns"), [(1, 96), (2, 96), (16, 2), (2, 2)])
def test_grids_of_a_row_or_two_show_what_they_can(rows, columns):
    narrow = {name: cut(maps(seed), rows, columns) for name, seed in (("intensity", 1), ("range", 2))}
    assert find_repeats(narrow, FINDING) == ()


def cut(of: Maps, rows: int, columns: int) -> Maps:
    return Maps.plain(of.weight[:, :rows, :columns], of.total[:, :rows, :columns])


def test_of_one_wave_there_is_one_pattern_however_its_phase_was_found():
    """Scenes that are sectors of few drives see a quarter of the columns each: what they add up to is not the wave's
    own phase, and another is left of it."""
    wave = 2 * np.cos(2 * np.pi * 3 * COLUMN / COLUMNS - 0.9)
    sector = np.arange(len(FINDING))[:, None, None] % 4
    weight = (sector == COLUMN * 4 // COLUMNS) * np.where(sector == 0, 5.0, 1.0)
    noise = np.random.default_rng(2).normal(size=weight.shape)
    [one] = find_repeats({"range": Maps.plain(weight, wave + 0.3 * noise)}, FINDING)
    assert (one.repeat.scale, one.repeat.period) == ("wave", COLUMNS / 3)
