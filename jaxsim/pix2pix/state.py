"""Everything that training changes, as one pytree."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import jax
import jax.numpy as jnp
import optax
from flax import nnx, struct

from jaxsim.config import Experiment, GeneratorConfig, OptimConfig
from jaxsim.frame import Array
from jaxsim.pix2pix.convolution import on_cpu
from jaxsim.pix2pix.networks import Discriminator, Precision, make_generator
from jaxsim.pix2pix.normalisation import SpectralVector, fold_spectral_norm

Tree = Any


@struct.dataclass
class Network:
    """A network's values: nested dicts by attribute name, as the modules nest."""

    parameters: Tree
    vectors: Tree
    """Spectral norm's singular vectors; every forward pass in training mode advances them."""


@struct.dataclass
class TrainState:
    """State of a run between two steps."""

    step: Array
    """int32: updates done."""
    generator: Network
    generator_optim: Tree
    discriminator: Network | None
    """None where no loss term uses it."""
    discriminator_optim: Tree
    ema: Tree
    """Averaged generator parameters with spectral norm folded in."""


def uses_discriminator(experiment: Experiment) -> bool:
    """Feature matching compares the discriminator's features: without the GAN term it is left out too."""
    return experiment.loss.gan > 0


def learning_rate(config: OptimConfig, step: Array) -> Array:
    """Rate of update `step`: after `warm_up` constant, then from `decay_from` of the steps on linearly to 0."""
    start = config.decay_from * config.steps
    done = jnp.asarray(step, jnp.float32)
    left = (config.steps - done) / max(config.steps - start, 1.0)
    rate = config.lr * jnp.clip(left, 0.0, 1.0) if start < config.steps else jnp.full((), config.lr)
    return rate * jnp.minimum((done + 1) / config.warm_up, 1.0) if config.warm_up else rate


def optimiser(config: OptimConfig) -> optax.GradientTransformation:
    """Adam with the rate above, on gradients of a norm of at most `clip`."""
    schedule: Callable[[Array], Array] = lambda step: learning_rate(config, step)  # noqa: E731
    adam = optax.adam(schedule, b1=config.betas[0], b2=config.betas[1], eps=config.eps)
    return optax.chain(optax.clip_by_global_norm(config.clip), adam) if config.clip else adam


def split(module: nnx.Module) -> tuple[Any, Network]:
    """Definition and values of a module."""
    definition, parameters, vectors = nnx.split(module, nnx.Param, SpectralVector)
    return definition, Network(nnx.to_pure_dict(parameters), nnx.to_pure_dict(vectors))


def join(definition: Any, network: Network) -> Any:
    """The module of a definition with these values."""
    return nnx.merge(definition, network.parameters, network.vectors)


def generator_definition(
    config: GeneratorConfig, in_channels: int, *, spectral: bool = True, precision: Precision = "float32"
) -> Any:
    """The generator without values; `spectral=False` for the averaged one."""
    make = lambda: make_generator(config, in_channels, nnx.Rngs(0), spectral=spectral, precision=precision)  # noqa: E731
    return nnx.graphdef(nnx.eval_shape(make))


def discriminator_definition(experiment: Experiment, in_channels: int) -> Any:
    """The discriminator without values, at the precision of training; it sees the inputs and the image."""
    channels, precision = in_channels + experiment.generator.out_channels, experiment.optim.precision
    make = lambda: Discriminator(experiment.discriminator, channels, nnx.Rngs(0), precision=precision)  # noqa: E731
    return nnx.graphdef(nnx.eval_shape(make))


def create_state(experiment: Experiment, in_channels: int, seed: int) -> TrainState:
    """A fresh state; the same for the same seed."""
    return _compiled_create()(experiment, in_channels, jax.random.key(seed))


def state_shapes(experiment: Experiment, in_channels: int) -> TrainState:
    """Shapes and types of a state, without its values."""
    return jax.eval_shape(lambda key: _create(experiment, in_channels, key), jax.random.key(0))


@cache
def _compiled_create() -> Callable[[Experiment, int, Array], TrainState]:
    # It runs once: on a CPU, LLVM would work on it several times as long as is saved.
    options = {"xla_backend_optimization_level": 0} if on_cpu() else None
    return jax.jit(_create, static_argnums=(0, 1), compiler_options=options)


def _create(experiment: Experiment, in_channels: int, key: Array) -> TrainState:
    key_g, key_d = jax.random.split(key)
    _, generator = split(make_generator(experiment.generator, in_channels, nnx.Rngs(key_g)))
    adam = optimiser(experiment.optim)
    discriminator, discriminator_optim = None, None
    if uses_discriminator(experiment):
        channels = in_channels + experiment.generator.out_channels
        _, discriminator = split(Discriminator(experiment.discriminator, channels, nnx.Rngs(key_d)))
        discriminator_optim = adam.init(discriminator.parameters)
    return TrainState(
        step=jnp.zeros((), jnp.int32),
        generator=generator,
        generator_optim=adam.init(generator.parameters),
        discriminator=discriminator,
        discriminator_optim=discriminator_optim,
        ema=fold_spectral_norm(generator.parameters, generator.vectors),
    )
