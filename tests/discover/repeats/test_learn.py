"""What repeats becomes laws with the size that was made, though it hides in the noise that it makes."""

from dataclasses import replace

import numpy as np
import pytest

from jaxsim.discover.repeats.examine import formula_of
from jaxsim.discover.repeats.find import find_repeats
from jaxsim.discover.repeats.learn import conjugate_gradients, learn_repeats, pattern_form
from jaxsim.effects.learned import Learned
from tests.discover.repeats.made import COLUMN, COLUMNS, FINDING, ROW, ROWS, maps

RNG = np.random.default_rng(5)
TAKEN = 0.3
"""Share of a pattern that levels take up, in these maps."""


def height_of(law: Learned) -> np.ndarray:
    """A law's height in each cell, straight from its definition."""
    numbers = {"row": ROW, "column": COLUMN, "even rows": ROW % 2, "even columns": COLUMN % 2}
    if law.kind == "wave":
        angle = 2 * np.pi * sum(numbers[name] * of[0] for name, of in zip(law.covariates, law.knots, strict=True))
        return law.values[0] * np.cos(angle) + law.values[1] * np.sin(angle)
    height = np.zeros(ROW.shape)
    for at, value in zip(np.ndindex(*map(len, law.knots)), law.values, strict=True):
        here = [numbers[name] == of[k] for name, of, k in zip(law.covariates, law.knots, at, strict=True)]
        height[np.logical_and.reduce(here)] = value
    return height


def learn(pattern, channel="intensity", *, usual_loss=1.0):
    """Of maps in which levels take up a share of everything, and weights fall where laws are not in place."""

    def maps_with(laws):
        left = pattern - sum((height_of(law) for law in laws), np.zeros(ROW.shape))
        made = maps(1, (1 - TAKEN) * left)
        # As a robust fit's weights and noise: the larger what is left, the smaller.
        weight = made.weight / (1 + np.mean(left**2))
        made = replace(made, weight=weight, total=made.total / (1 + np.mean(left**2)))
        return {channel: replace(made, response=lambda shape: (1 - TAKEN) * weight * shape), "other": maps(2)}

    first = maps_with([])
    found = find_repeats({channel: first[channel]}, FINDING)
    forms = [pattern_form(one, ROWS, COLUMNS, usual_loss=usual_loss) for one in found]
    return learn_repeats(forms, FINDING, maps_with)


CASES = {
    "wave": 0.6 * np.cos(2 * np.pi * 11 * COLUMN / COLUMNS + 1),
    "aslant": 0.6 * np.cos(2 * np.pi * (3 * ROW / ROWS - 5 * COLUMN / COLUMNS) + 2),
    "parity of rows": 0.9 * (ROW % 2 - 0.5),
    "chequerboard": 0.9 * ((ROW + COLUMN) % 2 - 0.5),
    "columns": -2.0 * (COLUMN // 3 == 8),
    "cell": 1.8 * ((ROW // 4 == 2) & (COLUMN // 3 == 8)),
    "any row": 0.8 * RNG.choice([-1.0, 1.0], (ROWS, 1)) + 0 * ROW,
}


@pytest.mark.parametrize("case", CASES)
def test_the_laws_together_are_the_pattern(case):
    pattern = CASES[case] - CASES[case].mean()
    learned = learn(CASES[case])
    height = np.sum([height_of(one.learned) for one in learned], axis=0)
    left = pattern - (height - height.mean())
    # What noise leaves of a number a row, and of a wave.
    assert np.mean(left**2) < (0.1 if case == "any row" else 0.03) * np.mean(pattern**2)
    assert all(one.judged_nats > 0 for one in learned)


@pytest.mark.parametrize(("case", "size"), [("wave", 0.6), ("parity of rows", 0.9), ("columns", -2.0)])
def test_sizes_are_those_that_were_made(case, size):
    [one, *_] = learn(CASES[case])
    assert one.repeat.size.low < size < one.repeat.size.high
    assert one.repeat.size.value == pytest.approx(size, rel=0.12)
    assert f"{one.repeat.size.value:.3g}" in one.repeat.formula


def test_a_fine_pattern_of_cells_is_shrunk_to_what_it_repeats():
    pattern = RNG.choice([-1.0, 1.0], (ROWS, COLUMNS))
    [one, *_] = learn(pattern)
    assert one.learned.covariates == ("row", "column")
    height = height_of(one.learned)
    assert np.mean((pattern - height) ** 2) < 0.6
    assert one.repeat.size.value == pytest.approx(1, rel=0.2)


def test_of_returns_no_share_below_none_is_lost():
    [one, *_] = learn(CASES["parity of rows"] / 3, channel="drop")
    assert one.learned.kind == "table"
    assert min(one.learned.values) == 0
    assert max(one.learned.values) == pytest.approx(0.3, abs=0.08)


@pytest.mark.parametrize(("usual", "added"), [(0.005, False), (1.0, True)])
def test_columns_of_which_fewer_are_lost_than_an_effect_says_add_nothing(usual, added):
    [one, *_] = learn(0.45 * CASES["columns"], channel="drop", usual_loss=usual)
    assert one.repeat.size.value == pytest.approx(-0.9, rel=0.2)
    assert one.can_be_added == added
    # What all others lose is told above the least, where so much is lost everywhere.
    others = height_of(one.learned)[:, COLUMN[0] // 3 != 8]
    assert others.mean() == pytest.approx(0.9 * added, abs=0.05)


@pytest.mark.parametrize(
    ("case", "variables", "given"),
    [
        ("wave", {"column": COLUMN}, {}),
        ("parity of rows", {"odd_row": ROW % 2}, {}),
        # Where hardly anything is lost everywhere, half of the parity is cut off.
        ("parity of rows", {"odd_row": ROW % 2}, {"channel": "drop", "usual_loss": 0.005}),
    ],
)
def test_the_formula_is_the_law(case, variables, given):
    learned = learn(CASES[case] / (3 if given else 1), **given)
    law = formula_of(learned)
    assert law
    numbers = {name: one.value for name, one in law.parameters.items()}
    height = eval(law.expression, {"sin": np.sin, "pi": np.pi, **numbers, **variables})
    assert height + 0.0 * ROW == pytest.approx(height_of(learned[0].learned), abs=0.08)
    assert law.limits.keys() == variables.keys()


def test_conjugate_gradients_solve_the_normal_equations():
    rng = np.random.default_rng(0)
    root = rng.normal(size=(30, 6))
    matrix = root.T @ root
    x = conjugate_gradients(lambda h: matrix @ h, matrix @ np.arange(6.0), 1 / np.diag(matrix))
    np.testing.assert_allclose(x, np.arange(6.0), atol=0.01)
    assert not conjugate_gradients(lambda h: matrix @ h, np.zeros(6), np.ones(6)).any()


def test_cells_have_no_formula():
    assert formula_of(learn(CASES["cell"])) is None
    assert formula_of(()) is None
