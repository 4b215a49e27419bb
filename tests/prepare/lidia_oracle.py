"""LIDIA in NumPy, float64, patch by patch: slow, and written from the paper's description and the published layers."""

import numpy as np

from jaxsim.prepare.denoise.lidia import Variant

RADIUS, NEIGHBOURS = 14, 14


def blurred(image):
    kernel = np.outer([1, 2, 1], [1, 2, 1]) / 16
    h, w, c = image.shape
    out = np.zeros((h - 2, w - 2, c))
    for i in range(3):
        for j in range(3):
            out += kernel[i, j] * image[i : i + h - 2, j : j + w - 2]
    return out


def patch(image, row, column, p, d):
    return image[row : row + d * p : d, column : column + d * p : d].transpose(2, 0, 1).ravel()


def grey_of(image):
    return image if image.shape[2] == 1 else image @ np.array([[0.2989], [0.5870], [0.1140]])


def look_around(image, p, d, chosen=None):
    """Neighbours (n, 14, numel) and distances (n, 14) of every patch of an image.

    `chosen` says which neighbours: mirrored borders make ties, and a choice among equals is nobody's fault.
    """
    far = np.pad(image, [(RADIUS * d, RADIUS * d)] * 2 + [(0, 0)], constant_values=-1.0)
    grey = grey_of(far)
    found, distances = [], []
    rows, columns = (size - d * (p - 1) for size in image.shape[:2])
    for row in range(rows):
        for column in range(columns):
            own = patch(grey, row + RADIUS * d, column + RADIUS * d, p, d)
            places = [(row + d * i, column + d * j) for i in range(2 * RADIUS + 1) for j in range(2 * RADIUS + 1)]
            square = np.array([((patch(grey, *place, p, d) - own) ** 2).sum() for place in places])
            square[RADIUS * (2 * RADIUS + 1) + RADIUS] = -1
            order = np.argsort(square, kind="stable")[:NEIGHBOURS]
            if chosen is not None:
                width = far.shape[1] - d * (p - 1)
                order = [places.index(divmod(int(number), width)) for number in chosen[row * columns + column]]
            near = np.array([patch(far, *places[k], p, d) for k in order])
            found.append(near)
            distances.append([*square[order[1:]], near[0].var(ddof=1) * near[0].size])
    return np.array(found), np.array(distances), (rows, columns)


class Oracle:
    """The network of a published state dict, with stored statistics."""

    def __init__(self, arrays, variant: Variant):
        self.w, self.variant = {name: np.asarray(a, np.float64) for name, a in arrays.items()}, variant

    def ver_hor(self, name, x):
        return self.w[f"{name}.hor.weight"] @ (x @ self.w[f"{name}.ver.weight"].T) + self.w[f"{name}.b"]

    def norm(self, name, x):
        scale, shift, mean, variance = (
            self.w[f"{name}.{part}"][:, None] for part in ("weight", "bias", "running_mean", "running_var")
        )
        return (x - mean) / np.sqrt(variance + 1e-5) * scale + shift

    def block(self, name, x):
        x = self.ver_hor(f"{name}.ver_hor", x)
        return np.maximum(self.norm(f"{name}.bn", x) if f"{name}.bn.weight" in self.w else x, 0)

    def blended(self, name, x, first, second):
        x = self.block(f"{name}.{first}", x)
        a = self.w.get(f"{name}.a")
        return x if a is None else a * x + (1 - a) * self.block(f"{name}.{second}", x)

    def weights(self, name, distance):
        x = distance[..., None]
        for k in range(6):
            x = np.maximum(self.norm(f"{name}.bn{k}", self.w[f"{name}.fc{k}.weight"] @ x), 0)
        return (self.w[f"{name}.fc_out.weight"] @ x)[..., 0] + self.w[f"{name}.fc_out.bias"]

    def aggregated(self, x, shape, d):
        """Vectors of overlapping patches (n, numel) replaced by what they agree on."""
        (rows, columns), p = shape, self.variant.p
        total = np.zeros((rows + d * (p - 1), columns + d * (p - 1), self.variant.channels))
        share = np.zeros_like(total)
        for k, vector in enumerate(x):
            r, c = divmod(k, columns)
            view = np.s_[r : r + d * p : d, c : c + d * p : d]
            total[view] += vector.reshape(-1, p, p).transpose(1, 2, 0)
            share[view] += 1
        mean = total / share
        if d == 2:
            mean = blurred(np.pad(mean, [(1, 1), (1, 1), (0, 0)], mode="reflect"))
        return np.array([patch(mean, *divmod(k, columns), p, d) for k in range(len(x))])

    def __call__(self, image, chosen):
        """The image without noise; `chosen` are the numbers of the neighbours at both scales."""
        v, net = self.variant, "separable_fc_net"
        mean = image.mean((0, 1), keepdims=True)
        image = image - mean
        mirrored = lambda m: np.pad(image, [(m, m), (m, m), (0, 0)], mode="reflect")  # noqa: E731
        fine = mirrored(v.p - 1)
        near0, distance0, shape = look_around(fine, v.p, 1, chosen[0])
        coarse = blurred(mirrored((v.p - 1) // 2 + v.p))
        near1, distance1, _ = look_around(coarse, v.p, 2, chosen[1])
        w0 = self.weights("weights_net0", np.exp(-abs(self.w["alpha0"]) * distance0))
        w1 = self.weights("weights_net1", np.exp(-abs(self.w["alpha1"]) * distance1))
        parts = ("ver_hor_bn_re0", "ver_hor_bn_re1")
        x0 = self.blended(f"{net}.sep_part1_s0", near0 * w0[..., None], *parts)
        x1 = self.blended(f"{net}.sep_part1_s1", near1 * w1[..., None], *parts)
        agreed0 = self.aggregated(self.ver_hor(f"{net}.ver_hor_agg0_pre", x0)[:, 0], shape, 1)
        first = w1[:, :1]
        agreed1 = first * self.aggregated(self.ver_hor(f"{net}.ver_hor_agg1_pre", x1)[:, 0] / first, shape, 2)
        more = [self.block(f"{net}.ver_hor_bn_re_agg{s}_post", x[:, None]) for s, x in enumerate((agreed0, agreed1))]
        x = np.concatenate([x0, x1, *more], axis=1)
        x = self.blended(f"{net}.sep_part2", x, "ver_hor_bn_re2", "ver_hor_bn_re3")
        clean = near0[:, 0] - self.ver_hor(f"{net}.sep_part2.ver_hor_out", x)[:, 0]
        weight = np.exp(-abs(self.w["beta"]) * clean.var(axis=-1))
        total = np.zeros_like(fine)
        share = np.zeros_like(fine)
        for k, vector in enumerate(clean):
            r, c = divmod(k, shape[1])
            view = np.s_[r : r + v.p, c : c + v.p]
            total[view] += weight[k] * vector.reshape(-1, v.p, v.p).transpose(1, 2, 0)
            share[view] += weight[k]
        m = v.p - 1
        return (total / share)[m:-m, m:-m] + mean


def random_state(shapes, seed):
    """A state dict with statistics that no two layers share."""
    rng, arrays = np.random.default_rng(seed), {}
    for name in sorted(shapes):
        x = rng.standard_normal(shapes[name])
        if name.endswith(("running_var", "bn.weight")) or (".bn" in name and name.endswith("weight")):
            x = 0.5 + abs(x)
        elif len(shapes[name]) == 2:
            x = x / np.sqrt(shapes[name][1])
        elif name in ("alpha0", "alpha1", "beta"):
            x = 0.2 + abs(x)
        arrays[name] = x.astype(np.float32)
    return arrays
