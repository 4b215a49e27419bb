"""The closed forms against plain generalised least squares, and against finite differences."""

import jax.numpy as jnp
import numpy as np

from jaxsim.discover.evidence import POSE_SD
from jaxsim.discover.nuisance import INSTANCE_SD, START, pose_shift, reflectance, weights


def test_reflectance_is_generalised_least_squares_with_random_objects(evidence):
    rng = np.random.default_rng(0)
    instance = rng.integers(0, 9, evidence.instance.shape) * 6 + np.arange(6)[:, None, None]
    instance = np.where(instance < 6, 0, instance - 5).astype(np.int32)
    ev = evidence.replace(instance=jnp.asarray(instance), instances=int(instance.max()) + 1)
    residual = jnp.asarray(rng.normal(0, 0.2, instance.shape), jnp.float32)
    w = weights(ev, START, residual * 0, residual * 0)
    fitted = jnp.asarray([1, 1, 1, 1, 0, 0], jnp.float32)
    found = np.asarray(reflectance(ev, w, fitted, residual), np.float64)

    on = np.asarray(ev.compared)
    block = np.broadcast_to(np.arange(6)[:, None, None], on.shape)[on]
    x, y = np.asarray(ev.features, np.float64)[on], np.asarray(residual, np.float64)[on]
    precision, own = np.asarray(w.intensity, np.float64)[on], instance[on]
    z = np.eye(ev.instances)[own] * (own > 0)[:, None]
    train = block < 4
    design = np.concatenate([x, z], axis=1)
    ridge = np.concatenate([np.asarray(ev.ridge, np.float64), np.full(ev.instances, 1 / INSTANCE_SD**2)])
    a = design[train]
    beta = np.linalg.solve(a.T @ (a * precision[train, None]) + np.diag(ridge), a.T @ (precision[train] * y[train]))
    shared = beta[: x.shape[1]]
    left = y - x @ shared
    total = z.T @ (precision * left) / (z.T @ precision + 1 / INSTANCE_SD**2)
    np.testing.assert_allclose(found[on], x @ shared + z @ total, atol=2e-4)


def test_pose_is_ridge_regression_of_each_frame(evidence):
    rng = np.random.default_rng(1)
    residual = jnp.asarray(rng.normal(0, 0.02, evidence.edge.shape), jnp.float32)
    w = weights(evidence, START, residual * 0, residual * 0)
    found = np.asarray(pose_shift(evidence, w, residual))
    for b in range(6):
        x = np.asarray(evidence.pose[b], np.float64).reshape(-1, 6)
        weight = np.asarray(w.range_[b], np.float64).ravel()
        y = np.where(weight > 0, np.asarray(residual[b], np.float64).ravel(), 0)
        beta = np.linalg.solve(x.T @ (x * weight[:, None]) + np.diag(1 / POSE_SD**2), x.T @ (weight * y))
        np.testing.assert_allclose(found[b].ravel(), x @ beta, atol=2e-4)


def test_pose_derivatives_are_those_of_a_road(evidence):
    """Lifting the sensor by dz lengthens a ray that looks down by e to the road by dz / sin e."""
    road = np.asarray((evidence.rays.semantic == 7) & ~evidence.edge)
    down = -np.sin(np.asarray(evidence.rays.elevation_rad))
    np.testing.assert_allclose(np.asarray(evidence.pose[..., 2])[road], 1 / down[road], rtol=0.03)
    # Pitching (about y, nose down positive) by w lowers a forward ray: the road is nearer by r cos / sin.
    ahead = road & (np.abs(np.asarray(evidence.rays.azimuth_rad)) < 0.2)
    slope = np.asarray(evidence.rays.range_m) / np.tan(-np.asarray(evidence.rays.elevation_rad))
    cosine = np.cos(np.asarray(evidence.rays.azimuth_rad))
    np.testing.assert_allclose(np.asarray(evidence.pose[..., 4])[ahead], -(slope * cosine)[ahead], rtol=0.03)
