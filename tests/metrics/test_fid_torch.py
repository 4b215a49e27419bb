"""The whole distance against one written in PyTorch from the papers' figures, on the same images and weights.

Skipped where PyTorch is not installed (it never needs to be).
"""

import numpy as np
import pytest
import scipy.linalg

from jaxsim.metrics.frechet import frechet_distance, halves
from jaxsim.metrics.inception import CONVERTERS, load_extractor, published_shapes
from jaxsim.weights import convert

torch = pytest.importorskip("torch")
F = torch.nn.functional


def plain(state, name, x, *, stride=1, padding=0):
    """Convolution, batch norm with stored statistics, ReLU."""
    x = F.conv2d(x, state[f"{name}.conv.weight"], None, stride, padding)
    parts = (state[f"{name}.bn.{part}"] for part in ("running_mean", "running_var", "weight", "bias"))
    mean, variance, weight, bias = parts
    return F.relu(F.batch_norm(x, mean, variance, weight, bias, False, 0.0, 1e-3))


def inception(state, x, form):
    """2048 features; the plan is figure 5 to 7 of Szegedy et al. 2016, with the kernels of the state dict."""

    def run(block, chain, x):
        for name in chain.split():
            stride = 2 if (block, name) in HALVING else 1
            kernel = state[f"{block}.{name}.conv.weight"].shape[2:]
            padding = (0, 0) if stride == 2 else tuple(k // 2 for k in kernel)
            x = plain(state, f"{block}.{name}", x, stride=stride, padding=padding)
        return x

    def average(x):
        return F.avg_pool2d(x, 3, 1, 1, count_include_pad=form == "torchvision")

    def largest(x):
        return F.max_pool2d(x, 3, 2)

    x = plain(state, "Conv2d_1a_3x3", x, stride=2)
    x = largest(plain(state, "Conv2d_2b_3x3", plain(state, "Conv2d_2a_3x3", x), padding=1))
    x = largest(plain(state, "Conv2d_4a_3x3", plain(state, "Conv2d_3b_1x1", x)))
    triple = "branch3x3dbl_1 branch3x3dbl_2 branch3x3dbl_3"
    for block in ("Mixed_5b", "Mixed_5c", "Mixed_5d"):
        sides = [run(block, chain, x) for chain in ("branch1x1", "branch5x5_1 branch5x5_2", triple)]
        x = torch.cat([*sides, run(block, "branch_pool", average(x))], 1)
    x = torch.cat([run("Mixed_6a", "branch3x3", x), run("Mixed_6a", triple, x), largest(x)], 1)
    seven = "branch7x7_1 branch7x7_2 branch7x7_3"
    double = " ".join(f"branch7x7dbl_{i}" for i in range(1, 6))
    for block in ("Mixed_6b", "Mixed_6c", "Mixed_6d", "Mixed_6e"):
        sides = [run(block, chain, x) for chain in ("branch1x1", seven, double)]
        x = torch.cat([*sides, run(block, "branch_pool", average(x))], 1)
    wide = " ".join(f"branch7x7x3_{i}" for i in range(1, 5))
    x = torch.cat([run("Mixed_7a", "branch3x3_1 branch3x3_2", x), run("Mixed_7a", wide, x), largest(x)], 1)
    for block in ("Mixed_7b", "Mixed_7c"):
        once, twice = run(block, "branch3x3_1", x), run(block, "branch3x3dbl_1 branch3x3dbl_2", x)
        forks = [run(block, f"branch3x3_2{side}", once) for side in "ab"]
        forks += [run(block, f"branch3x3dbl_3{side}", twice) for side in "ab"]
        last = form == "pytorch_fid" and block == "Mixed_7c"
        pooled = F.max_pool2d(x, 3, 1, 1) if last else average(x)
        x = torch.cat([run(block, "branch1x1", x), *forks, run(block, "branch_pool", pooled)], 1)
    return x.mean((2, 3))


HALVING = {
    ("Mixed_6a", "branch3x3"),
    ("Mixed_6a", "branch3x3dbl_3"),
    ("Mixed_7a", "branch3x3_2"),
    ("Mixed_7a", "branch7x7x3_4"),
}
"""Convolutions of stride 2, which have no padding."""


def fid_in_torch(state, a, b, form):
    def features(images):
        x = torch.from_numpy(images).permute(0, 3, 1, 2).expand(-1, 3, -1, -1)
        if form == "torchvision":
            x = F.interpolate(x.clamp(-1, 1), (299, 299), mode="bicubic", align_corners=True)
        else:
            x = 2 * F.interpolate((x + 1) / 2, (299, 299), mode="bilinear", align_corners=False) - 1
        with torch.no_grad():
            return inception(state, x, form).double().numpy()

    x, y = features(a), features(b)
    first, second = np.cov(x, rowvar=False), np.cov(y, rowvar=False)
    step = x.mean(0) - y.mean(0)
    # Of the centred data: eigenvalues of (X Y') (X Y')' are those of the covariances' product.
    centred = [(z - z.mean(0)) / np.sqrt(len(z) - 1) for z in (x, y)]
    product = np.linalg.multi_dot([centred[0], centred[1].T, centred[1], centred[0].T])
    root = np.sqrt(np.clip(scipy.linalg.eigvals(product).real, 0, None)).sum()
    return step @ step + np.trace(first) + np.trace(second) - 2 * root


@pytest.mark.parametrize("kind", ["inception", "inception_fid"])
def test_the_distance_equals_that_of_an_independent_program(kind, tmp_path):
    form = {"inception": "torchvision", "inception_fid": "pytorch_fid"}[kind]
    rng = np.random.default_rng(0)
    arrays = {}
    for name, shape in published_shapes(form).items():
        draw = rng.standard_normal(shape)
        if len(shape) > 1:
            draw = draw * np.sqrt(2 / np.prod(shape[1:]))
        elif name.endswith(("bn.weight", "running_var")):
            draw = 1 + 0.1 * np.abs(draw)
        else:
            draw = 0.1 * draw
        arrays[name] = draw.astype(np.float32)
    torch.save({name: torch.from_numpy(array) for name, array in arrays.items()}, tmp_path / "state.pth")
    convert(kind, CONVERTERS[kind], tmp_path / "state.pth", out=tmp_path / "converted.npz")
    extractor = load_extractor(tmp_path / "converted.npz")

    smooth = rng.uniform(-1, 1, (12, 8, 32, 1)).repeat(8, 1).repeat(8, 2)
    a = smooth[:6].astype(np.float32)
    b = np.clip(smooth[6:] * 0.7 + 0.2 * rng.standard_normal(smooth[6:].shape), -1, 1).astype(np.float32)
    ours = frechet_distance(*(halves(extractor.batches(images, 6)).whole for images in (a, b)))
    state = {name: torch.from_numpy(array) for name, array in arrays.items()}
    assert ours == pytest.approx(fid_in_torch(state, a, b, form), rel=1e-3)
