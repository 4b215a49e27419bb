"""Published checkpoints of pix2pixHD: our weights from their names and layouts; what a file holds, the sizes of its
networks, and training from it.

Kernels are (out, in, kh, kw) there, those of transposed convolutions (in, out, kh, kw) and turned by half a circle;
the right singular vectors run over (in, kh, kw).
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from flax import nnx
from jaxtyping import PyTree

from jaxsim.config import DiscriminatorConfig, Experiment, GeneratorConfig, Pix2PixForm
from jaxsim.files import placed
from jaxsim.pix2pix.layers import fold_spectral_norm
from jaxsim.pix2pix.networks import Discriminator, Generator
from jaxsim.pix2pix.steps import Network, TrainState, split
from jaxsim.weights import Arrays, Converter, checked_arrays, kernel_of, load_weights, published_shape, weights_kind

Keys = tuple[Any, ...]

UNUSED = re.compile(r"\.(running_mean|running_var|num_batches_tracked)$")
"""Statistics that old versions of PyTorch saved for instance norms, which take each image's own."""
LEAF_NAMES: dict[str, dict[tuple[str, str], str]] = {
    "imaginaire": {
        ("conv", "kernel"): "layers.conv.weight",
        ("conv", "bias"): "layers.conv.bias",
        ("conv", "left"): "layers.conv.weight_u",
        ("conv", "right"): "layers.conv.weight_v",
        ("norm", "scale"): "layers.norm.weight",
        ("norm", "shift"): "layers.norm.bias",
    },
    "original": {("conv", "kernel"): "weight", ("conv", "bias"): "bias"},
}
"""What the published programs call our arrays of a layer."""


class Place(NamedTuple):
    """Where a published program keeps one of our arrays."""

    name: str
    kernel_shape: tuple[int, ...]
    """Ours, of the kernel that the array belongs to; () for a norm's arrays."""
    transposed: bool
    """The kernel is a transposed convolution's."""


def from_published(arrays: Arrays, like: Network, form: Pix2PixForm = "imaginaire") -> Network:
    """Our values from published ones; `like` gives the structure and may be abstract (`jax.eval_shape`).

    Raises ValueError naming the arrays that are missing, have another shape, or have no place in the network; but
    running statistics that instance norms do not use are left alone.
    """
    places = places_of(like, form)
    leaves = jax.tree.leaves_with_path((like.parameters, like.vectors))
    # The first step of a path says which of the two trees.
    slots = [(places[keys_of(path[1:])], leaf.shape) for path, leaf in leaves]
    shapes = {slot.name: published_shape(shape, transposed=slot.transposed) for slot, shape in slots}
    then = "set generator.* or discriminator.* to the checkpoint's form and sizes"
    with placed(f"published weights do not fit the configured network ({form} form)", then=then):
        values = checked_arrays(arrays, shapes)
        if strange := [name for name in arrays if name not in shapes and not UNUSED.search(name)]:
            raise ValueError(f"{', '.join(strange[:5])} has no place there")
    structure = jax.tree.structure((like.parameters, like.vectors))
    return Network(*jax.tree.unflatten(structure, [_ours(values[slot.name], slot) for slot, _ in slots]))


def _ours(array: np.ndarray, slot: Place) -> np.ndarray:
    if array.ndim == 4:
        return kernel_of(array, transposed=slot.transposed)
    if slot.name.endswith("weight_v"):
        kh, kw, channels = slot.kernel_shape[:3]
        return array.reshape(channels, kh, kw).transpose(1, 2, 0).reshape(-1)
    return array


def keys_of(path: Any) -> Keys:
    """The names along a path that `jax.tree` gives."""
    return tuple(step.key for step in path)


def places_of(network: Network, form: Pix2PixForm) -> dict[Keys, Place]:
    """The published place of every leaf by its path."""
    spectral = {keys_of(path)[:-1] for path, _ in jax.tree.leaves_with_path(network.vectors)}
    kernels = {
        keys_of(path)[:-1]: leaf.shape
        for path, leaf in jax.tree.leaves_with_path(network.parameters)
        if keys_of(path)[-1] == "kernel"
    }
    places = {}
    for path, _ in jax.tree.leaves_with_path((network.parameters, network.vectors)):
        # The first step says which of the two trees.
        keys = keys_of(path[1:])
        name = f"{_layer_name(keys[:-2], network.parameters, form)}.{LEAF_NAMES[form][keys[-2:]]}"
        if keys[-1] == "kernel" and keys[:-1] in spectral:
            # PyTorch keeps the trained kernel so; its `weight` is what the norm makes of it.
            name += "_orig"
        places[keys] = Place(name, kernels.get(keys[:-1], ()), form == "original" and "up" in keys)
    return places


def _layer_name(keys: Keys, parameters: PyTree, form: Pix2PixForm) -> str:
    """The published name of the layer that has this path in our network."""
    original = form == "original"
    if keys[0] == "scales":
        _, scale, *layer = keys
        number = layer[1] if layer[0] == "features" else len(parameters["scales"][scale]["features"])
        if original:  # there the coarsest scale is the first by name
            return f"scale{len(parameters['scales']) - 1 - scale}_layer{number}.0"
        return f"model.discriminators.{scale}.layer{number}.0"
    # Places in a `Sequential`. The original counts paddings, norms and activations too, three places a convolution;
    # Imaginaire counts blocks, and an up-sampling layer without weights before each of `up`.
    stem, apart, up_apart = (1, 3, 3) if original else (0, 1, 2)
    if keys[0] == "coarse":
        part, keys = parameters["coarse"], keys[1:]
        # Imaginaire's global generator on its own keeps its head and stands one level deeper.
        before = "model" if original else "global_model.model" if "head" in part else "global_model"
        after, first_block = before, stem + apart * (1 + len(part["down"]))
    else:
        _, k, *layer = keys
        part, keys = parameters["enhancers"][k], tuple(layer)
        first_block = 0
        before, after = (
            (f"model{k + 1}_1", f"model{k + 1}_2")
            if original
            else (f"enhancer_{k}.model_downsample", f"enhancer_{k}.model_upsample")
        )
    first_up = first_block + len(part["blocks"])
    match keys:
        case ("stem",):
            return f"{before}.{stem}"
        case ("down", i):
            return f"{before}.{stem + apart * (1 + i)}"
        case ("blocks", i, half):
            second = half == "second"
            inner = f"conv_block.{5 if second else 1}" if original else f"conv_block_{int(second)}"
            return f"{after}.{first_block + i}.{inner}"
        case ("up", i):
            return f"{after}.{first_up + up_apart * i + 1 - stem}"
        case ("head",):
            return f"{after}.{first_up + up_apart * len(part['up']) + stem}"
    raise ValueError(f"no published name for {keys}")


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
