"""Networks of the segmentation study: what they are told, and what they learn."""

import numpy as np
import pytest

from jaxsim.config import QUANTILES, GeneratorConfig, SegmentationConfig
from jaxsim.data.logs.range_images import read_range_images
from jaxsim.simulate.grain import Field
from jaxsim.studies.segmentation.networks import (
    class_loss,
    classify,
    geometry,
    intensity_loss,
    of_learned_sensor,
    of_segmentation,
    simulate,
    train_network,
)


def test_a_cell_without_a_return_tells_nothing_but_its_line_and_class(folder):
    image = read_range_images(folder)[0]
    assert not image.valid[0, 0]
    assert not geometry(image)[0, 0].any()
    assert geometry(image)[1, 1, 0] == pytest.approx(np.log(image.range_m[1, 1]) / np.log(120))
    told = of_learned_sensor(image, 3)
    assert told.shape == (4, 16, 5 + 4 + 3)
    assert told[2, 5, 5 + 2] == 1
    assert told[2, 5, 5 + 4 + image.label[2, 5]] == 1
    assert of_segmentation(image, image.intensity)[2, 5, -1] == image.intensity[2, 5]


def test_the_loss_is_the_cross_entropy_of_weighted_cells():
    random = np.random.default_rng(0)
    logits = random.normal(size=(1, 2, 3, 4)).astype(np.float32)
    label, weight = random.integers(0, 4, (1, 2, 3)), random.random((1, 2, 3)).astype(np.float32)
    shares = np.exp(logits) / np.exp(logits).sum(-1, keepdims=True)
    right = np.take_along_axis(shares, label[..., None], -1)[..., 0]
    truth = -(weight * np.log(right)).sum() / weight.sum()
    assert float(class_loss(logits, {"label": label, "weight": weight})) == pytest.approx(truth, rel=1e-5)


def test_no_cell_is_told_to_be_unlabelled(folder):
    images = read_range_images(folder)
    inputs = [of_segmentation(image, image.intensity) for image in images]
    targets = [{"label": image.label, "weight": (image.label > 0).astype(np.float32)} for image in images]
    config = SegmentationConfig(network=GeneratorConfig(form="unet", filters=2, downsamples=0, enhancers=0), columns=8)
    network = train_network(inputs, targets, class_loss, out_channels=3, steps=1, seed=0, config=config)
    assert {*np.unique(classify(network, inputs))} <= {1, 2}


def test_intensities_scatter_together_or_each_cell_for_itself(folder):
    images = read_range_images(folder)
    inputs = [of_learned_sensor(image, 3) for image in images]
    targets = [{"intensity": image.intensity, "weight": image.valid.astype(np.float32)} for image in images]
    config = SegmentationConfig(network=GeneratorConfig(form="unet", filters=2, downsamples=0, enhancers=0), columns=8)
    sensor = train_network(
        inputs, targets, intensity_loss, out_channels=len(QUANTILES) + 1, steps=1, seed=0, config=config
    )
    together = (Field(1.0, None, None),)
    (grained,) = simulate(sensor, inputs[:1], images[:1], grain=together, seed=0)
    (single,) = simulate(sensor, inputs[:1], images[:1], grain=None, seed=0)
    assert not grained[~images[0].valid].any()
    ones = images[0].label == 1
    assert grained[ones].std() < single[ones].std()
