"""An additive model predicts held-out scenes by what the others show."""

import numpy as np

from jaxsim.discover.find.additive import Additive

SCENES, EACH = 8, 50


def made(seed: int, height: float) -> tuple[Additive, np.ndarray]:
    rng = np.random.default_rng(seed)
    groups = np.eye(3, dtype=np.float32)[rng.integers(0, 3, SCENES * EACH)]
    z = groups @ np.array([height, 0, -height]) + rng.normal(0, 1, SCENES * EACH)
    return Additive(z, {"group": groups}, np.repeat(np.arange(SCENES), EACH), scenes=SCENES), z


def test_a_prediction_is_ridge_regression_on_the_other_folds():
    model, z = made(0, 1.0)
    held = model.scene % 4 == 1
    x = model.x.astype(float)
    beta = np.linalg.solve(x[~held].T @ x[~held] + 4.0 * np.eye(4), x[~held].T @ z[~held])
    np.testing.assert_allclose(model.predicted(["group"])[held], x[held] @ beta, rtol=1e-4, atol=1e-5)


def test_every_scene_gains_by_what_is_there_and_pays_for_what_is_not():
    model, _ = made(1, 1.0)
    gain, rate = model.by_scene(model.predicted([]), model.predicted(["group"]))
    assert (gain > 0).all()
    assert (rate > gain).all()
    empty = [made(seed, 0.0)[0] for seed in range(2, 22)]
    lost = [one.by_scene(one.predicted([]), one.predicted(["group"]))[0].sum() for one in empty]
    assert np.mean(lost) < 0
