"""The experiments' values."""

from dataclasses import replace

import pytest

import configs


@pytest.mark.parametrize("name", ["rgb", "semantic", "edges", "depth"])
def test_the_papers_experiments_differ_in_their_inputs_alone(name):
    combined, _ = configs.load("kitti_step_combined")
    experiment, _ = configs.load(f"kitti_step_{name}")
    assert experiment.prepare.inputs == (name,)
    assert set(experiment.prepare.inputs) < set(combined.prepare.inputs)
    assert replace(experiment, prepare=combined.prepare) == combined
    assert replace(experiment.prepare, inputs=combined.prepare.inputs) == combined.prepare


def test_the_papers_settings_are_those_of_imaginaires_configuration():
    experiment, _ = configs.load("kitti_step_combined")
    generator, optim, loss = experiment.generator, experiment.optim, experiment.loss
    assert (generator.form, generator.filters, generator.downsamples, generator.blocks) == ("imaginaire", 64, 4, 9)
    assert (generator.enhancers, generator.enhancer_blocks) == (1, 3)
    assert (optim.epochs, optim.batch, optim.lr, optim.betas, optim.eps) == (20, 8, 2e-4, (0.5, 0.999), 1e-8)
    assert (optim.ema_decay, optim.ema_start, optim.flip, optim.scale_limit) == (0.999, 500, False, 0.2)
    assert (loss.gan, loss.feature_matching, loss.perceptual, loss.reconstruction) == (1, 10, 10, 0)
    assert optim.decay_from == 1  # constant: the published rate falls after 100 epochs
    assert experiment.prepare.network_size == (64, 512)
