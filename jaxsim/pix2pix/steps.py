"""The training step and the generator as jitted functions of plain pytrees.

One step, in Imaginaire's order: the discriminator learns from a generated image, then the generator learns
from a fresh forward pass, then the average moves.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import optax
from flax import nnx

from jaxsim.config import Experiment
from jaxsim.pix2pix.convolution import on_cpu
from jaxsim.pix2pix.convolution_cpu import compiler_options
from jaxsim.pix2pix.losses import adversarial, feature_matching, hinge, reconstruction
from jaxsim.pix2pix.normalisation import fold_spectral_norm
from jaxsim.pix2pix.state import (
    Network,
    TrainState,
    discriminator_definition,
    generator_definition,
    join,
    learning_rate,
    optimiser,
    split,
    uses_discriminator,
)
from jaxsim.pix2pix.vgg import Weights, load_vgg, perceptual

Array = Any
Tree = Any
Batch = dict[str, Array]
"""inputs (b, h, w, c); target (b, h, w, k) in [-1, 1]; weight (b, h, w) >= 0, of the reconstruction term."""
Metrics = dict[str, Array]


def make_train_step(
    experiment: Experiment, in_channels: int, *, vgg: Weights | None = None
) -> Callable[[TrainState, Batch], tuple[TrainState, Metrics]]:
    """Jitted (state, batch) -> (state, metrics); the given state is donated.

    Metrics are scalars: `loss/...` of each term in use, unweighted, `loss/generator` and `loss/discriminator`
    weighted; `lr`, `grad_norm/...`, and `finite`, False if a loss or gradient is not. `vgg` spares reading
    `loss.vgg_weights`. Raises FileNotFoundError if the perceptual loss has no weights, ValueError if no
    loss term is left.
    """
    weights = experiment.loss
    adversary = uses_discriminator(experiment)
    if not (adversary or weights.perceptual or weights.reconstruction):
        raise ValueError("every loss term has weight 0: set loss.gan, loss.perceptual or loss.reconstruction")
    if weights.perceptual and vgg is None:
        vgg = load_vgg(weights.vgg_weights)
    generator = generator_definition(experiment.generator, in_channels)
    discriminator = discriminator_definition(experiment, in_channels) if adversary else None
    adam = optimiser(experiment.optim)

    def generate(network: Network, inputs: Array) -> tuple[Array, Network]:
        module = join(generator, network)
        return module(inputs, train=True), split(module)[1]

    def judge(network: Network, inputs: Array, image: Array) -> tuple[Any, Network]:
        module = join(discriminator, network)
        return module(inputs, image, train=True), split(module)[1]

    def discriminator_loss(parameters: Tree, vectors: Tree, batch: Batch, fake: Array):
        network = Network(parameters, vectors)
        on_fake, network = judge(network, batch["inputs"], fake)
        on_real, network = judge(network, batch["inputs"], batch["target"])
        loss = weights.gan * (hinge(on_real, "real") + hinge(on_fake, "fake"))
        return loss, network.vectors

    def generator_loss(parameters: Tree, vectors: Tree, judges: Network | None, batch: Batch, vgg: Weights | None):
        inputs, target = batch["inputs"], batch["target"]
        image, network = generate(Network(parameters, vectors), inputs)
        terms = {}
        if judges is not None:
            on_fake, judges = judge(judges, inputs, image)
            on_real, judges = judge(judges, inputs, target)
            terms["gan"] = adversarial(on_fake)
            if weights.feature_matching:
                terms["feature_matching"] = feature_matching(on_fake, on_real)
        if vgg is not None and weights.perceptual:
            terms["perceptual"] = perceptual(vgg, image, target)
        if weights.reconstruction:
            terms["reconstruction"] = reconstruction(image, target, batch["weight"])
        total = sum(getattr(weights, name) * term for name, term in terms.items())
        return total, (terms, network.vectors, None if judges is None else judges.vectors)

    def train_step(state: TrainState, batch: Batch, *, vgg: Weights | None) -> tuple[TrainState, Metrics]:
        metrics: Metrics = {"lr": learning_rate(experiment.optim, state.step)}
        judges, vectors = state.discriminator, state.generator.vectors
        judges_optim = state.discriminator_optim
        if judges is not None:
            fake, network = generate(state.generator, batch["inputs"])
            vectors = network.vectors
            (loss, judge_vectors), gradient = jax.value_and_grad(discriminator_loss, has_aux=True)(
                judges.parameters, judges.vectors, batch, fake
            )
            updates, judges_optim = adam.update(gradient, judges_optim)
            judges = Network(optax.apply_updates(judges.parameters, updates), judge_vectors)
            metrics |= {"loss/discriminator": loss, "grad_norm/discriminator": optax.tree.norm(gradient)}

        (loss, (terms, vectors, judge_vectors)), gradient = jax.value_and_grad(generator_loss, has_aux=True)(
            state.generator.parameters, vectors, judges, batch, vgg
        )
        updates, optim = adam.update(gradient, state.generator_optim)
        trained = Network(optax.apply_updates(state.generator.parameters, updates), vectors)
        metrics |= {f"loss/{name}": term for name, term in terms.items()}
        metrics |= {"loss/generator": loss, "grad_norm/generator": optax.tree.norm(gradient)}
        metrics["finite"] = jnp.stack([jnp.isfinite(value) for value in metrics.values()]).all()
        step = state.step + 1
        state = TrainState(
            step=step,
            generator=trained,
            generator_optim=optim,
            discriminator=None if judges is None else Network(judges.parameters, judge_vectors),
            discriminator_optim=judges_optim,
            ema=_average(experiment, state.ema, trained, step),
        )
        return state, metrics

    return partial(
        jax.jit(train_step, donate_argnums=0, compiler_options=compiler_options() if on_cpu() else None), vgg=vgg
    )


def _average(experiment: Experiment, ema: Tree, generator: Network, step: Array) -> Tree:
    """Moving average of the folded generator; up to `ema_start` updates it is a copy."""
    decay = jnp.where(step <= experiment.optim.ema_start, 0.0, experiment.optim.ema_decay)
    folded = fold_spectral_norm(generator.parameters, generator.vectors)
    return jax.tree.map(lambda old, new: decay * old + (1 - decay) * new, ema, folded)


def make_generate(experiment: Experiment, in_channels: int) -> Callable[[Tree, Array], Array]:
    """Jitted (`ema_generator(state)`, inputs (b, h, w, c)) -> image (b, h, w, k) in [-1, 1]."""
    definition = generator_definition(experiment.generator, in_channels, spectral=False)
    return jax.jit(lambda parameters, inputs: nnx.merge(definition, parameters)(inputs))
