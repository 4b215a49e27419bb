"""The closed forms against plain generalised least squares, and against finite differences."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np

from jaxsim.discover.model.cast import FIRM, STREET_SD, STRIP_SD
from jaxsim.discover.model.evidence import POSE_SD
from jaxsim.discover.model.noise import START
from jaxsim.discover.model.random_effects import normal_equations, pose_shift, reflectance


def test_reflectance_is_generalised_least_squares_with_random_surfaces_and_streets(evidence):
    rng = np.random.default_rng(0)
    # Strips 1..96 of surfaces 1..48, those of each frame its own; 0 is none.
    strip = rng.integers(0, 17, evidence.edge.shape) * 6 + np.arange(6)[:, None, None]
    strip = np.where(strip < 6, 0, strip - 5).astype(np.int32)
    of = np.arange(97)
    of = np.where(of > 0, (of - 1) // 12 * 6 + (of - 1) % 6 + 1, 0).astype(np.int32)
    hold = np.concatenate([[FIRM], np.where(np.arange(48) % 2, 1 / 0.2**2, 1 / 0.1**2)]).astype(np.float32)
    ev = evidence.replace(strip=jnp.asarray(strip), surface=jnp.asarray(of), precision=jnp.asarray(hold))
    residual = jnp.asarray(rng.normal(0, 0.2, strip.shape), jnp.float32)
    w = normal_equations(ev, START, (residual * 0, residual * 0))
    in_fit = jnp.asarray([1, 1, 1, 1, 0, 0], jnp.float32)
    found, cost = (np.asarray(x, np.float64) for x in reflectance(ev, w, in_fit, residual=residual))

    on = np.asarray(ev.compared)
    block = np.broadcast_to(np.arange(6)[:, None, None], on.shape)[on]
    x, y = np.asarray(ev.features, np.float64)[on], np.asarray(residual, np.float64)[on]
    precision = np.asarray(w.intensity, np.float64)[on]
    kinds = x.shape[1] - 1 - ev.after_kinds
    # One column a strip, one a surface, and one a class and frame; their priors.
    streets = [x[:, 1 : 1 + kinds] * (block == b)[:, None] for b in range(6)]
    z = np.concatenate([np.eye(97)[strip[on]][:, 1:], np.eye(49)[of[strip[on]]][:, 1:], *streets], axis=1)
    own = [np.full(96, 1 / STRIP_SD**2), np.asarray(hold[1:], np.float64), np.full(6 * kinds, 1 / STREET_SD**2)]
    own = np.concatenate(own)
    train = block < 4
    design = np.concatenate([x, z], axis=1)
    ridge = np.concatenate([np.asarray(ev.ridge, np.float64), own])
    a = design[train]
    beta = np.linalg.solve(a.T @ (a * precision[train, None]) + np.diag(ridge), a.T @ (precision[train] * y[train]))
    shared = beta[: x.shape[1]]
    left = y - x @ shared
    random = np.linalg.solve(z.T @ (z * precision[:, None]) + np.diag(own), z.T @ (precision * left))
    np.testing.assert_allclose(found[on], x @ shared + z @ random, atol=3e-4)
    assert not found[~on].any()
    np.testing.assert_allclose(cost.sum(), 0.5 * own @ random**2, rtol=1e-3)


def test_pose_is_ridge_regression_of_each_frame(evidence):
    """In 1 / range, which is linear in the motion: small residuals are those of the range."""
    rng = np.random.default_rng(1)
    residual = rng.normal(0, 0.002, evidence.edge.shape)
    reading = evidence.rays.reading_m
    on = evidence.rays.hit & evidence.returned & ~evidence.edge
    ev = evidence.replace(range_m=jnp.where(on, reading + jnp.asarray(residual, jnp.float32), evidence.range_m))
    w = normal_equations(ev, START, (jnp.zeros(on.shape), jnp.zeros(on.shape)))
    found, cost = (np.asarray(x) for x in pose_shift(ev, w, reading, on=on))
    for b in range(6):
        x = np.asarray(ev.pose[b], np.float64).reshape(-1, 6)
        weight = np.asarray(w.range_[b], np.float64).ravel()
        y = np.where(weight > 0, residual[b].ravel(), 0)
        beta = np.linalg.solve(x.T @ (x * weight[:, None]) + np.diag(1 / POSE_SD**2), x.T @ (weight * y))
        np.testing.assert_allclose(found[b].ravel(), x @ beta, atol=3e-4)
        np.testing.assert_allclose(cost[b], 0.5 * ((beta / POSE_SD) ** 2).sum(), rtol=0.02, atol=1e-4)


def test_a_tilted_sensor_is_taken_up_far_down_the_road(evidence):
    """The road at 60 m moves by metres, not in proportion: the model holds there."""
    tilt = 0.002
    rays = evidence.rays
    road = np.asarray((rays.semantic == 7) & ~evidence.edge & rays.hit)
    down = -np.asarray(rays.elevation_rad, np.float64)
    moved = np.asarray(rays.range_m) * np.sin(down) / np.sin(down + tilt * np.cos(np.asarray(rays.azimuth_rad)))
    ev = evidence.replace(range_m=jnp.asarray(np.where(road, moved, 0), jnp.float32), returned=jnp.asarray(road))
    w = normal_equations(ev, START, (jnp.zeros(road.shape), jnp.zeros(road.shape)))
    found, _ = pose_shift(ev, w, rays.reading_m, on=jnp.asarray(road))
    left = (moved - np.asarray(rays.reading_m) - np.asarray(found))[road]
    assert np.abs(left).max() < 0.03 * np.abs(moved - np.asarray(rays.reading_m))[road].max()


def test_what_an_effect_scatters_is_no_outlier_to_the_pose(evidence):
    off = jnp.full(evidence.edge.shape, 0.05)
    sure = START.replace(range_=jnp.float32(np.log(1e-3)))
    usual = START.replace(range_=jnp.float32(np.log(np.hypot(1e-3, 0.05 / np.sqrt(12)))))
    rounded = evidence.replace(rays=replace(evidence.rays, range_step_m=jnp.float32(0.05)))
    by_step = normal_equations(rounded, sure, (off, off))
    np.testing.assert_allclose(by_step.range_, normal_equations(evidence, usual, (off, off)).range_, rtol=1e-4)


def test_weights_of_several_threads_at_once_do_not_wait_for_each_other(evidence):
    """LAPACK's calls on several matrices did, for ever, on two cores (`products.inverse`)."""
    zero = jnp.zeros(evidence.edge.shape)
    assert "lapack" not in normal_equations.lower(evidence, START, (zero, zero)).as_text()
