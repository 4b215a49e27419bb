"""The training step and the generator as jitted functions of plain pytrees.

One step, in Imaginaire's order: the discriminator learns from a generated image, then the generator learns
from a fresh forward pass, then the average moves. In the original's order (`optim.updates`) both learn from the same
image and from each other as they were.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import optax
from flax import nnx, struct
from jax.sharding import Mesh
from jaxtyping import Float, PyTree

from jaxsim.compilation import compiled_to_run_once
from jaxsim.config import QUANTILES, Experiment, GeneratorConfig, OptimConfig
from jaxsim.devices import CUT, DATA, WHOLE, everywhere
from jaxsim.frame import Array
from jaxsim.pix2pix.convolution import compiler_options, on_cpu
from jaxsim.pix2pix.layers import SpectralVector, fold_spectral_norm
from jaxsim.pix2pix.losses import (
    LossWeights,
    discriminator_loss,
    drop_loss,
    generator_terms,
    load_vgg,
    perceptual,
    quantile_loss,
    reconstruction,
)
from jaxsim.pix2pix.networks import Discriminator, Precision, make_generator

PairBatch = dict[str, Array]
"""inputs (b, h, w, c); target (b, h, w, k) in [-1, 1]; weight (b, h, w) >= 0, of the reconstruction term; and of
`unet` dropped and returned (b, h, w): cells that drop, and those whose beam came back."""


@struct.dataclass
class Network:
    """A network's values: nested dicts by attribute name, as the modules nest."""

    parameters: PyTree
    vectors: PyTree
    """Spectral norm's singular vectors; every forward pass in training mode advances them."""


@struct.dataclass
class TrainState:
    """State of a run between two steps."""

    step: Array
    """int32: updates done."""
    generator: Network
    generator_optim: PyTree
    discriminator: PyTree
    """A Network; None where no loss term uses it."""
    discriminator_optim: PyTree
    ema: PyTree
    """Averaged generator parameters with spectral norm folded in."""


def uses_discriminator(experiment: Experiment) -> bool:
    """Feature matching compares the discriminator's features: without the GAN term it is left out too."""
    return experiment.loss.gan > 0


def learning_rate(config: OptimConfig, step: Array) -> Array:
    """Rate of update `step`: after `warm_up` constant, then from `decay_from` of the steps on linearly to 0."""
    start = config.decay_from * config.steps
    done = jnp.asarray(step, jnp.float32)
    remaining = (config.steps - done) / max(config.steps - start, 1.0)
    rate = config.lr * jnp.clip(remaining, 0.0, 1.0) if start < config.steps else jnp.full((), config.lr)
    return rate * jnp.minimum((done + 1) / config.warm_up, 1.0) if config.warm_up else rate


def optimiser(config: OptimConfig) -> optax.GradientTransformation:
    """Adam with the rate above, on gradients of a norm of at most `clip`."""
    adam = optax.adam(partial(learning_rate, config), b1=config.betas[0], b2=config.betas[1], eps=config.eps)
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
    return compiled_to_run_once(_create, (0, 1))(experiment, in_channels, jax.random.key(seed))


def state_shapes(experiment: Experiment, in_channels: int) -> TrainState:
    """Shapes and types of a state, without its values."""
    return jax.eval_shape(partial(_create, experiment, in_channels), jax.random.key(0))


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


def make_train_step(
    experiment: Experiment, in_channels: int, *, vgg: LossWeights | None = None, mesh: Mesh | None = None
) -> Callable[[TrainState, PairBatch], tuple[TrainState, dict[str, Array]]]:
    """Jitted (state, batch) -> (state, metrics); the given state is donated.

    Metrics are scalars: `loss/...` of each term in use, unweighted, `loss/generator` and `loss/discriminator`
    weighted; `lr`, `grad_norm/...`, and `finite`, False if a loss or gradient is not. `vgg` spares reading
    `loss.vgg_weights`. On a `mesh` every device takes its part of the batch; losses and gradients are means over
    all. An item's instance statistics are its own, so nothing else crosses devices.

    Raises FileNotFoundError if the perceptual loss has no weights, ValueError if no loss term is left.
    """
    weights = experiment.loss
    adversary = uses_discriminator(experiment)
    if experiment.generator.form == "unet" and (adversary or weights.perceptual):
        raise ValueError(
            "generator: a unet gives quantiles, which no discriminator and no VGG can look at; set --loss.gan 0 "
            "--loss.perceptual 0, and --loss.reconstruction above 0"
        )
    if not (adversary or weights.perceptual or weights.reconstruction):
        raise ValueError("every loss term has weight 0: set loss.gan, loss.perceptual or loss.reconstruction")
    if weights.perceptual and vgg is None:
        vgg = load_vgg(weights.vgg_weights)
    graphs = Graphs(
        experiment,
        generator_definition(experiment.generator, in_channels, precision=experiment.optim.precision),
        discriminator_definition(experiment, in_channels) if adversary else None,
        shared=mesh is not None,
    )
    step = partial(_train_step, graphs=graphs)
    if mesh is not None:
        step = jax.shard_map(step, mesh=mesh, in_specs=(WHOLE, CUT, WHOLE), out_specs=WHOLE, check_vma=False)
        vgg = everywhere(mesh, vgg)
    return partial(
        jax.jit(
            lambda state, batch, *, vgg: step(state, batch, vgg),
            # Old and new state share their memory.
            donate_argnums=0,
            compiler_options=compiler_options() if on_cpu() else None,
        ),
        vgg=vgg,
    )


@dataclass(frozen=True)
class Graphs:
    """Both networks without values, as a training step runs them."""

    experiment: Experiment
    generator: Any
    discriminator: Any
    """None where no loss term uses it."""
    shared: bool
    """Whether devices share a batch."""

    def generate(self, network: Network, inputs: Array) -> tuple[Array, Network]:
        """The image, and the network after this pass."""
        module = join(self.generator, network)
        return module(inputs, train=True), split(module)[1]

    def discriminate(self, network: Network, inputs: Array, image: Array) -> tuple[Any, Network]:
        """The discriminator's answer and features, and the network after this pass."""
        module = join(self.discriminator, network)
        return module(inputs, image, train=True), split(module)[1]

    def mean(self, tree: PyTree) -> PyTree:
        """Takes the mean over the devices that share the batch; their parts are of one size."""
        return jax.lax.pmean(tree, DATA) if self.shared else tree


def _train_step(
    state: TrainState, batch: PairBatch, vgg: LossWeights | None, *, graphs: Graphs
) -> tuple[TrainState, dict[str, Array]]:
    """Both networks' updates, in the order that the experiment says, and the average's."""
    config = graphs.experiment.optim
    metrics: dict[str, Array] = {"lr": learning_rate(config, state.step)}
    discriminator = state.discriminator
    discriminator_optim = state.discriminator_optim
    vectors = state.generator.vectors
    # Imaginaire's order: the generator then learns from a discriminator that has seen an image of this step.
    first = config.updates == "discriminator_first"
    if discriminator is not None and first:
        fake, network = graphs.generate(state.generator, batch["inputs"])
        vectors = network.vectors
        discriminator, discriminator_optim, of_discriminator = _train_discriminator(
            discriminator, discriminator_optim, batch, fake=fake, graphs=graphs
        )
        metrics |= of_discriminator

    def loss_of(parameters: PyTree) -> tuple[Array, Any]:
        return _generator_loss(Network(parameters, vectors), discriminator, batch, vgg=vgg, graphs=graphs)

    (loss, (terms, fake, vectors, discriminator)), gradient = jax.value_and_grad(loss_of, has_aux=True)(
        state.generator.parameters
    )
    loss, terms, gradient = graphs.mean((loss, terms, gradient))
    updates, optim = optimiser(config).update(gradient, state.generator_optim)
    trained = Network(optax.apply_updates(state.generator.parameters, updates), vectors)
    metrics |= {f"loss/{name}": term for name, term in terms.items()}
    metrics |= {"loss/generator": loss, "grad_norm/generator": optax.tree.norm(gradient)}

    if discriminator is not None and not first:
        discriminator, discriminator_optim, of_discriminator = _train_discriminator(
            discriminator, discriminator_optim, batch, fake=fake, graphs=graphs
        )
        metrics |= of_discriminator
    metrics["finite"] = jnp.stack([jnp.isfinite(value) for value in metrics.values()]).all()
    step = state.step + 1
    state = TrainState(
        step=step,
        generator=trained,
        generator_optim=optim,
        discriminator=discriminator,
        discriminator_optim=discriminator_optim,
        ema=_average(graphs.experiment, state.ema, trained, step=step),
    )
    return state, metrics


def _generator_loss(
    network: Network, discriminator: Network | None, batch: PairBatch, *, vgg: LossWeights | None, graphs: Graphs
) -> tuple[Array, tuple[dict[str, Array], Array, PyTree, Network | None]]:
    """The generator's loss; and its terms, the image, its vectors and the discriminator after their passes."""
    experiment = graphs.experiment
    weights = experiment.loss
    inputs, target = batch["inputs"], batch["target"]
    image, network = graphs.generate(network, inputs)
    terms = {}
    if discriminator is not None:
        on_fake, discriminator = graphs.discriminate(discriminator, inputs, image)
        # Every pass moves the spectral norms' vectors on, so that the order, fake and then real, counts.
        on_real, discriminator = graphs.discriminate(discriminator, inputs, target)
        terms |= generator_terms(on_fake, on_real, weights.form)
        if not weights.feature_matching:
            del terms["feature_matching"]
    if vgg is not None and weights.perceptual:
        precision = experiment.optim.precision
        compute = None if precision == "float32" else jnp.dtype(precision)
        terms["perceptual"] = perceptual(vgg, image, target, imagenet=weights.form == "imaginaire", compute=compute)
    if experiment.generator.form == "unet":
        intensity, weight = (target[..., 0] + 1) / 2, batch["weight"]
        returned = weight * batch["returned"].astype(weight.dtype)
        terms["reconstruction"] = quantile_loss(image, intensity, returned, mean=graphs.mean)
        terms["drops"] = drop_loss(image, batch["dropped"], weight, mean=graphs.mean)
    elif weights.reconstruction:
        terms["reconstruction"] = reconstruction(image, target, batch["weight"], mean=graphs.mean)
    total = sum(getattr(weights, name) * term for name, term in terms.items())
    return total, (terms, image, network.vectors, discriminator)


def _train_discriminator(
    discriminator: Network, optim: PyTree, batch: PairBatch, *, fake: Array, graphs: Graphs
) -> tuple[Network, PyTree, dict[str, Array]]:
    weights = graphs.experiment.loss

    # The image is a constant here: the gradient is taken in the discriminator's own parameters alone.
    def loss_of(parameters: PyTree) -> tuple[Array, PyTree]:
        on_fake, network = graphs.discriminate(Network(parameters, discriminator.vectors), batch["inputs"], fake)
        on_real, network = graphs.discriminate(network, batch["inputs"], batch["target"])
        return weights.gan * discriminator_loss(on_fake, on_real, weights.form), network.vectors

    (loss, vectors), gradient = jax.value_and_grad(loss_of, has_aux=True)(discriminator.parameters)
    # Vectors follow from the kernels alone, and need no mean: they are the same on every device.
    loss, gradient = graphs.mean((loss, gradient))
    updates, optim = optimiser(graphs.experiment.optim).update(gradient, optim)
    discriminator = Network(optax.apply_updates(discriminator.parameters, updates), vectors)
    return discriminator, optim, {"loss/discriminator": loss, "grad_norm/discriminator": optax.tree.norm(gradient)}


def _average(experiment: Experiment, ema: PyTree, generator: Network, *, step: Array) -> PyTree:
    """Moving average of the folded generator; up to `ema_start` updates it is a copy."""
    decay = jnp.where(step <= experiment.optim.ema_start, 0.0, experiment.optim.ema_decay)
    # Kernels change by more than their parameters, for the norm changes too: the average is of what a pass uses.
    folded = fold_spectral_norm(generator.parameters, generator.vectors)
    return jax.tree.map(lambda old, new: decay * old + (1 - decay) * new, ema, folded)


class Look(NamedTuple):
    """A window as a network that gives a distribution may see it: in a mirror or not, and with rows added that repeat
    those beside them in reverse."""

    mirrored: bool
    above: int = 0
    below: int = 0

    def at(self, inputs: Float[Array, "b h w c"]) -> Float[Array, "b h_more w c"]:
        """The inputs as they are seen."""
        seen = inputs[:, :, ::-1] if self.mirrored else inputs
        return jnp.pad(seen, ((0, 0), (self.above, self.below), (0, 0), (0, 0)), mode="reflect")

    def back(self, outputs: Float[Array, "b h_more w k"], rows: int) -> Float[Array, "b rows w k"]:
        """What was answered so, each cell where it is without."""
        outputs = outputs[:, self.above : self.above + rows]
        return outputs[:, :, ::-1] if self.mirrored else outputs


LOOKS = (Look(False), Look(True), Look(False, above=6, below=10), Look(True, above=11, below=5))
"""The first so many of them are taken. Mirrored, the window is of another street of the same sensor; lifted, its rows
are told by what they show and not by their place. Errors of the answers partly cancel. With 16 more rows in all a
network's halvings fill up no more than without; rows that they put together come apart, lifted by 11 at once, by 6 one
halving deeper."""


def make_generate(experiment: Experiment, in_channels: int) -> Callable[[PyTree, Array], Array]:
    """Jitted (`TrainState.ema`, inputs (b, h, w, c)) -> image (b, h, w, k) in [-1, 1]; of a U-Net QUANTILES so, as far
    from the median as `generator.widen` says, and the logit of a drop, each the mean of `generator.looks`.

    Raises ValueError where a network without quantiles is to have them wider.
    """
    definition = generator_definition(experiment.generator, in_channels, spectral=False)
    form = experiment.generator.form
    widen = experiment.generator.widen
    median = QUANTILES.index(0.5)
    if form != "unet" and widen != 1:
        raise ValueError(f"generator.widen is {widen}; {form} gives no quantiles that could be wider: only unet does")

    def generate(parameters: PyTree, inputs: Float[Array, "b h w c"]) -> Float[Array, "b h w k"]:
        network = nnx.merge(definition, parameters)
        if form != "unet":
            return network(inputs)
        answers = [look.back(network(look.at(inputs)), inputs.shape[1]) for look in LOOKS[: experiment.generator.looks]]
        outputs = jnp.mean(jnp.stack(answers), axis=0)
        if widen == 1:
            return outputs
        quantiles, rest = outputs[..., : len(QUANTILES)], outputs[..., len(QUANTILES) :]
        middle = quantiles[..., median : median + 1]
        return jnp.concatenate([middle + widen * (quantiles - middle), rest], axis=-1)

    return jax.jit(generate)
