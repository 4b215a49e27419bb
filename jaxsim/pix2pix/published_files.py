"""Published checkpoints of pix2pixHD as files: what they hold, the sizes of their networks, training from them."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from flax import nnx

from jaxsim.config import DiscriminatorConfig, Experiment, GeneratorConfig, Pix2PixForm
from jaxsim.pix2pix.layers import fold_spectral_norm
from jaxsim.pix2pix.networks import Discriminator, Generator
from jaxsim.pix2pix.published import from_published
from jaxsim.pix2pix.steps import Network, TrainState, split
from jaxsim.weights import Arrays, Converter, load_weights, weights_kind

GENERATOR = "generator."
AVERAGED = "averaged."
DISCRIMINATOR = "discriminator."
KEPT = (GENERATOR, AVERAGED, DISCRIMINATOR)
IMAGINAIRE_PREFIXES = {
    "net_G.module.averaged_model.": AVERAGED,
    "net_G.averaged_model.": AVERAGED,
    "net_G.module.module.": GENERATOR,
    "net_G.module.": GENERATOR,
    "net_D.module.": DISCRIMINATOR,
    **{name: name for name in KEPT},
}
"""What Imaginaire's trainer wraps its networks in, the first that fits: data parallelism, and around the generator
its moving average (`utils/trainer.py`, `utils/model_average.py`)."""
IMAGINAIRE_FINE, ORIGINAL_FINE = "enhancer_{}.model_upsample.", "model{}_2."
"""The second half of an enhancer."""


def part(arrays: Arrays, prefix: str) -> dict[str, np.ndarray]:
    """The arrays whose names begin so, without it."""
    return {name[len(prefix) :]: array for name, array in arrays.items() if name.startswith(prefix)}


def generator_sizes(arrays: Arrays, form: Pix2PixForm) -> tuple[GeneratorConfig, int]:
    """Settings and input channels of the generator that a state dict is of.

    Raises ValueError where its names are not those of a pix2pixHD generator in this form.
    """
    alone = any(name.startswith("global_model.model.") for name in arrays)
    coarse, numbered, fine, start = {
        "imaginaire": ("global_model.model." if alone else "global_model.", r"enhancer_(\d+)\.", IMAGINAIRE_FINE, 0),
        "original": ("model.", r"model(\d+)_1\.", ORIGINAL_FINE, 1),
    }[form]
    enhancers = len({match[1] for name in arrays if (match := re.match(numbered, name))})
    layers = _layers(arrays, coarse)
    last = _layers(arrays, fine.format(start + enhancers - 1)) if enhancers else layers
    # Stem, halvings, residual blocks, doublings, head: where the blocks begin tells the halvings.
    residual = [is_block for is_block, _ in layers]
    if True not in residual or residual[0] or not last or last[-1][0]:
        some = ", ".join(sorted(arrays)[:3]) or "nothing"
        raise ValueError(f"it is no pix2pixHD generator in the {form} form: it holds {some} ...")
    stem = layers[0][1]
    widest = layers[residual.index(True) - 1][1]
    head = last[-1][1]
    downsamples = residual.index(True) - 1
    config = GeneratorConfig(
        form=form,
        filters=stem[0],
        max_filters=_cap(widest[0], stem[0] * 2**downsamples, GeneratorConfig.max_filters),
        downsamples=downsamples,
        blocks=sum(residual),
        enhancers=enhancers,
        enhancer_blocks=sum(is_block for is_block, _ in last) if enhancers else 0,
        out_channels=head[0],
    )
    return config, stem[1]


def discriminator_sizes(arrays: Arrays, form: Pix2PixForm) -> tuple[DiscriminatorConfig, int]:
    """Settings and channels (inputs and image) of the discriminator that a state dict is of. Raises as above."""
    pattern = {
        "imaginaire": r"model\.discriminators\.(\d+)\.layer(\d+)\.0\.layers\.conv\.weight(?:_orig)?",
        "original": r"scale(\d+)_layer(\d+)\.0\.weight",
    }[form]
    kernels = {
        (int(match[1]), int(match[2])): array.shape
        for name, array in arrays.items()
        if (match := re.fullmatch(pattern, name)) and array.ndim == 4
    }
    scales = {key[0] for key in kernels}
    depth = {key[1] for key in kernels}
    if len(depth) < 3 or len(kernels) != len(scales) * len(depth) or (0, 0) not in kernels:
        some = ", ".join(sorted(arrays)[:3]) or "nothing"
        raise ValueError(f"it is no pix2pixHD discriminator in the {form} form: it holds {some} ...")
    # Behind the layers at stride 2 come one at stride 1 and the logits.
    filters, layers = kernels[0, 0][0], len(depth) - 2
    widest = kernels[0, layers][0]
    config = DiscriminatorConfig(
        form=form,
        scales=len(scales),
        filters=filters,
        max_filters=_cap(widest, filters * 2**layers, DiscriminatorConfig.max_filters),
        layers=layers,
    )
    return config, kernels[0, 0][1]


def published_generator(
    arrays: Arrays, form: Pix2PixForm, *, averaged: bool = False
) -> tuple[GeneratorConfig, int, Network]:
    """Settings, input channels and values of a published generator. `averaged` has spectral norm folded in."""
    config, channels = generator_sizes(arrays, form)
    make = lambda: split(Generator(config, channels, nnx.Rngs(0), spectral=not averaged))[1]  # noqa: E731
    return config, channels, from_published(arrays, jax.eval_shape(make), form)


def published_discriminator(arrays: Arrays, form: Pix2PixForm) -> tuple[DiscriminatorConfig, int, Network]:
    """Settings, channels and values of a published discriminator."""
    config, channels = discriminator_sizes(arrays, form)
    like = jax.eval_shape(lambda: split(Discriminator(config, channels, nnx.Rngs(0)))[1])
    return config, channels, from_published(arrays, like, form)


def _imaginaire(arrays: Arrays) -> dict[str, np.ndarray]:
    """The networks of a checkpoint of Imaginaire's trainer, without what it is wrapped in."""
    renamed = {}
    for name, array in arrays.items():
        prefix = next((p for p in IMAGINAIRE_PREFIXES if name.startswith(p)), None)
        # How many updates an average has seen is no weight.
        if prefix and not name.endswith("num_updates_tracked"):
            renamed[IMAGINAIRE_PREFIXES[prefix] + name[len(prefix) :]] = np.asarray(array, np.float32)
    _, channels, _ = published_generator(part(renamed, GENERATOR), "imaginaire")
    if averaged := part(renamed, AVERAGED):
        published_generator(averaged, "imaginaire", averaged=True)
    if judges := part(renamed, DISCRIMINATOR):
        _, seen, _ = published_discriminator(judges, "imaginaire")
        # A discriminator sees the inputs and, beside them, an image of one channel at least.
        if seen <= channels:
            raise ValueError(f"its discriminator sees {seen} channels, its generator alone {channels}")
    return renamed


def _original(arrays: Arrays, prefix: str, check: Callable[[Arrays, Pix2PixForm], Any]) -> dict[str, np.ndarray]:
    """One network's state dict of NVIDIA/pix2pixHD; old versions of PyTorch ran it inside a `module`."""
    inner = arrays if any(name.startswith(prefix) for name in arrays) else None
    plain = part(arrays, prefix) if inner else {name.removeprefix("module."): a for name, a in arrays.items()}
    check(plain, "original")
    return {prefix + name: np.asarray(array, np.float32) for name, array in plain.items()}


CONVERTERS = {
    "pix2pixhd_imaginaire": Converter(
        "pix2pixHD of NVlabs/imaginaire",
        "a checkpoint that Imaginaire's train.py wrote (*_checkpoint.pt), or one from its model zoo "
        "(github.com/NVlabs/imaginaire, projects/pix2pixhd)",
        _imaginaire,
    ),
    "pix2pixhd_generator": Converter(
        "the generator of NVIDIA/pix2pixHD",
        "latest_net_G.pth (github.com/NVIDIA/pix2pixHD, checkpoints/label2city_1024p)",
        partial(_original, prefix=GENERATOR, check=published_generator),
    ),
    "pix2pixhd_discriminator": Converter(
        "the discriminator of NVIDIA/pix2pixHD",
        "latest_net_D.pth, which its train.py writes (github.com/NVIDIA/pix2pixHD)",
        partial(_original, prefix=DISCRIMINATOR, check=published_discriminator),
    ),
}
"""What `jaxsim convert` makes of published pix2pixHD weights."""


def start_from(state: TrainState, files: Sequence[Path], experiment: Experiment) -> TrainState:
    """The state with networks from converted files instead of random ones; the optimisers' start at nothing.

    Raises FileNotFoundError, and ValueError where a file holds other weights, another form or other sizes.
    """
    for path in files:
        kind = weights_kind(path) if path.is_file() else next(iter(CONVERTERS))
        if kind not in CONVERTERS:
            raise ValueError(f"start: {path} holds no pix2pixHD weights but {kind}; kinds: {', '.join(CONVERTERS)}")
        form: Pix2PixForm = "imaginaire" if kind == "pix2pixhd_imaginaire" else "original"
        arrays = load_weights(path, kind, CONVERTERS[kind]).arrays
        for prefix, config in ((GENERATOR, experiment.generator), (DISCRIMINATOR, experiment.discriminator)):
            if part(arrays, prefix) and config.form != form:
                raise ValueError(f"start: {path} is of the {form} form; pass --{prefix}form {form}")
        if values := part(arrays, GENERATOR):
            generator = _on_device(from_published(values, state.generator, form))
            # A file without averaged weights starts the average at copies of the weights themselves: a step gives away
            # the memory of its state, and no array can be given away twice.
            ema = jax.tree.map(jnp.copy, fold_spectral_norm(generator.parameters, generator.vectors))
            if averaged := part(arrays, AVERAGED):
                ema = _on_device(from_published(averaged, Network(state.ema, {}), form)).parameters
            state = replace(state, generator=generator, ema=ema)
        elif state.discriminator is None:
            raise ValueError(f"start: {path} is a discriminator's, and --loss.gan 0 trains without one; leave it out")
        if (values := part(arrays, DISCRIMINATOR)) and state.discriminator is not None:
            state = replace(state, discriminator=_on_device(from_published(values, state.discriminator, form)))
    return state


def _on_device(network: Network) -> Network:
    """Arrays of their own: those of the file are not a step's to give away."""
    return jax.tree.map(jnp.array, network)


def _layers(arrays: Arrays, prefix: str) -> list[tuple[bool, tuple[int, ...]]]:
    """A `Sequential`'s convolutions in their order: whether it is a residual block, and the shape of its kernel."""
    layers: dict[int, tuple[bool, tuple[int, ...]]] = {}
    for name, array in arrays.items():
        match = re.fullmatch(re.escape(prefix) + r"(\d+)\.(.*)weight(?:_orig)?", name)
        if match and array.ndim == 4:
            layers[int(match[1])] = ("conv_block" in match[2], array.shape)
    return [layers[i] for i in sorted(layers)]


def _cap(widest: int, uncapped: int, usual: int) -> int:
    """The setting `max_filters` of a network whose widest layer would be `uncapped` without one."""
    # A cap that no layer reaches may have been any: the usual one is taken.
    return widest if widest < uncapped else max(widest, usual)
