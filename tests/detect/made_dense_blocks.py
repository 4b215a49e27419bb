"""What tests of dense_blocks are made of."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxsim.detect.steps import join, split


def drawn(make, dtype=np.float64):
    """Definition and values of a module, all of them drawn at random; variances are positive."""
    with jax.enable_x64(False):
        definition, network = split(make())
    rng = np.random.default_rng(0)

    def draw(path, leaf):
        positive = "variance" in jax.tree_util.keystr(path)
        values = rng.uniform(0.5, 2, leaf.shape) if positive else rng.normal(0, 0.6, leaf.shape)
        return jnp.asarray(values.astype(dtype))

    return definition, jax.tree_util.tree_map_with_path(draw, network)


def used(definition, network, *inputs, **settings):
    """The module's output in use."""
    return jax.tree.map(np.asarray, join(definition, network)(*map(jnp.asarray, inputs), **settings))


def normed(x, parameters, statistics, eps):
    """Batch norm in use."""
    scale, shift = (np.asarray(parameters[name]) for name in ("scale", "shift"))
    mean, variance = (np.asarray(statistics[name]) for name in ("mean", "variance"))
    return (x - mean) / np.sqrt(variance + eps) * scale + shift


def convolved(x, kernel, stride):
    """3 x 3, padded by 1, cell by cell."""
    b, h, w, _ = x.shape
    padded = np.pad(x, ((0, 0), (1, 1), (1, 1), (0, 0)))
    out = np.zeros((b, (h - 1) // stride + 1, (w - 1) // stride + 1, kernel.shape[-1]))
    for row, column in np.ndindex(out.shape[1:3]):
        patch = padded[:, stride * row : stride * row + 3, stride * column : stride * column + 3]
        out[:, row, column] = np.tensordot(patch, kernel, 3)
    return out


def enlarged(x, kernel):
    """Transposed convolution whose kernel is as wide as its stride, cell by cell."""
    b, h, w, _ = x.shape
    stride = len(kernel)
    out = np.zeros((b, h * stride, w * stride, kernel.shape[-1]))
    for row, column, i, j in np.ndindex(h, w, stride, stride):
        out[:, row * stride + i, column * stride + j] += x[:, row, column] @ kernel[i, j]
    return out


def block(x, parameters, statistics, layer):
    """A convolution `layer` of x, batch norm in use, ReLU."""
    kernel = np.asarray(parameters["kernel"])
    return np.maximum(normed(layer(x, kernel), parameters["norm"], statistics["norm"], 1e-3), 0)


def connected(x, parameters, statistics):
    """Linear maps, batch norm in use, ReLU."""
    for layer, p, s in zip(
        parameters["layers"].values(), parameters["norms"].values(), statistics["norms"].values(), strict=True
    ):
        x = np.maximum(normed(x @ np.asarray(layer["kernel"]), p, s, 1e-5), 0)
    return x
