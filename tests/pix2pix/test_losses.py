"""Loss terms against their formulas in NumPy."""

import numpy as np
import pytest

from jaxsim.pix2pix.losses import adversarial, feature_matching, hinge, reconstruction


def judgement(seed):
    random = np.random.default_rng(seed)
    draw = lambda *shape: (2 * random.standard_normal(shape)).astype(np.float32)  # noqa: E731
    return [(draw(2, 4, 6, 1), [draw(2, 8, 12, 3), draw(2, 4, 6, 5)]), (draw(2, 2, 3, 1), [draw(2, 4, 6, 3)])]


def test_hinge_and_adversarial_losses_are_means_over_scales():
    judged = judgement(0)
    real = np.mean([np.maximum(0, 1 - x).mean() for x, _ in judged])
    fake = np.mean([np.maximum(0, 1 + x).mean() for x, _ in judged])
    np.testing.assert_allclose(hinge(judged, "real"), real, rtol=1e-5)
    np.testing.assert_allclose(hinge(judged, "fake"), fake, rtol=1e-5)
    np.testing.assert_allclose(adversarial(judged), -np.mean([x.mean() for x, _ in judged]), rtol=1e-5)


def test_feature_matching_sums_layers_and_averages_scales():
    fake, real = judgement(1), judgement(2)
    total = sum(
        np.abs(f - r).mean() for (_, a), (_, b) in zip(fake, real, strict=True) for f, r in zip(a, b, strict=True)
    )
    np.testing.assert_allclose(feature_matching(fake, real), total / 2, rtol=1e-5)


def test_reconstruction_is_a_weighted_error_of_intensity():
    random = np.random.default_rng(3)
    image, target = random.uniform(-1, 1, (2, 2, 3, 4, 1)).astype(np.float32)
    weight = random.integers(0, 3, (2, 3, 4)).astype(np.float32)
    slow = (weight * np.abs((image + 1) / 2 - (target + 1) / 2)[..., 0]).sum() / weight.sum()
    np.testing.assert_allclose(reconstruction(image, target, weight), slow, rtol=1e-5)


@pytest.mark.parametrize("value", [0.0])
def test_reconstruction_without_any_weight_is_0(value):
    image = np.ones((1, 2, 2, 1), np.float32)
    assert reconstruction(image, -image, np.full((1, 2, 2), value, np.float32)) == 0
