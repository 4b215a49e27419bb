"""Probabilities by signs of whole scenes against slow loops over all signs, scales and channels."""

from itertools import product

import numpy as np
import pytest

from jaxsim.discover.repeats.chance import of_maps, of_patterns, scatter
from jaxsim.discover.scenes import signs_of

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
