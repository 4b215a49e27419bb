"""A minimum is found in few looks, within its bounds, and a search that single precision cannot help is left."""

import numpy as np

from jaxsim.discover.model.minimum import Bounds, Point, minimum

FREE: Bounds = [(None, None)] * 6
SD = np.full(6, 2.0)


def bowl(curvature, centre, *, floor=0.0, of=np.float64):
    """A quadratic loss above `floor`, in some precision, that counts how often it is asked."""
    asked: list[np.ndarray] = []

    def objective(x):
        asked.append(x)
        away = x - centre
        loss = float(of(floor + 0.5 * curvature @ away**2))
        return Point(x, loss, curvature * away, f"look {len(asked)}")

    return objective, asked


def test_entries_of_very_different_curvature_are_found_in_a_dozen_looks():
    centre = np.array([0.5, -0.3, 0.2, 0.8, -0.1, 0.4])
    objective, asked = bowl(np.array([1e4, 1.0, 3e3, 20.0, 1e5, 400.0]), centre)
    best = minimum(objective, np.zeros(6), sd=SD, bounds=FREE, steps=40, enough=1e-6)
    np.testing.assert_allclose(best.x, centre, atol=1e-4)
    assert len(asked) <= 12


def test_what_else_came_out_is_that_of_the_lowest_point():
    objective, asked = bowl(np.ones(6), np.ones(6))
    best = minimum(objective, np.zeros(6), sd=SD, bounds=FREE, steps=40, enough=1e-6)
    number = int(best.more.removeprefix("look "))
    np.testing.assert_array_equal(asked[number - 1], best.x)


def test_bounds_hold_and_equal_ones_fix_an_entry():
    objective, asked = bowl(np.array([1.0, 100.0, 1.0, 1.0, 1.0, 1.0]), np.ones(6))
    bounds = [(0.3, 0.3), (None, 0.5), (1.5, None), *FREE[3:]]
    best = minimum(objective, np.zeros(6), sd=SD, bounds=bounds, steps=40, enough=1e-6)
    np.testing.assert_allclose(best.x, [0.3, 0.5, 1.5, 1, 1, 1], atol=1e-4)
    np.testing.assert_array_equal(asked[0], [0.3, 0, 1.5, 0, 0, 0])


def test_no_look_is_taken_beyond_a_bound():
    bounds = [(None, 0.0), (0.0, None), (-5.0, 0.0), *FREE[3:]]
    objective, asked = bowl(np.ones(6), np.array([-1.0, 1, -1, 1, 1, 1]))
    minimum(objective, np.zeros(6), sd=SD, bounds=bounds, steps=40, enough=1e-6)
    looks = np.array(asked)
    assert (looks[:, [0, 2]] <= 0).all()
    assert (looks[:, 1] >= 0).all()
    assert (looks[1] != 0).all()


def test_where_nothing_can_be_gained_few_looks_are_taken():
    # The slope promises a thousandth of what the number of the loss can show.
    objective, asked = bowl(np.ones(6), np.full(6, 1e-3), floor=-20_000.0, of=np.float32)
    best = minimum(objective, np.zeros(6), sd=SD, bounds=FREE, steps=40, enough=0.05)
    assert best.loss == -20_000
    assert len(asked) <= 8


def valley(x):
    """Rosenbrock's, in three planes."""
    a, b = x[::2], x[1::2]
    gradient = np.empty(6)
    gradient[::2] = -2 * (1 - a) - 400 * a * (b - a**2)
    gradient[1::2] = 200 * (b - a**2)
    return Point(x, float(((1 - a) ** 2 + 100 * (b - a**2) ** 2).sum()), gradient, None)


START = np.tile([-1.2, 1.0], 3)


def test_a_line_that_is_bad_is_left_and_the_search_goes_on():
    lowest, walls = valley(START), []

    def objective(x):
        nonlocal lowest
        point = valley(x)
        promised = float(lowest.gradient @ (lowest.x - x))
        # Once, on a line that promises little, two points in turn lie behind a wall.
        if len(walls) < 2 and 0 < promised < 0.1:
            walls.append(lowest.loss)
            return point._replace(loss=point.loss + 100)
        lowest = min(lowest, point, key=lambda one: one.loss)
        return point

    best = minimum(objective, START, sd=SD, bounds=FREE, steps=200, enough=0.1)
    assert len(walls) == 2
    assert best.loss < walls[0] - 0.1


def test_few_steps_are_few():
    short = minimum(valley, START, sd=SD, bounds=FREE, steps=3, enough=1e-9)
    long = minimum(valley, START, sd=SD, bounds=FREE, steps=200, enough=1e-9)
    assert valley(START).loss > short.loss > 1e-2 > 1e-6 > long.loss
    np.testing.assert_allclose(long.x, 1, atol=1e-3)
