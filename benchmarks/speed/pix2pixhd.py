"""pix2pixHD at 64 x 512: generator forward and whole training step, against the same network in PyTorch.

python benchmarks/speed/pix2pixhd.py [small|half|full ...] [--batch 1 8] [--rounds 5] [--channels-last] [--one-core]
                               [--compile] [--precision bfloat16] [--peak 989]

`small`, `half` and `full` are 16, 32 and 64 filters. 40 input channels, one image channel, GAN and feature
matching losses. On a machine that others use too, take --one-core: it pins the process to one core, for
OpenMP's threads wait for each other by the time slice when they lack cores, which is not PyTorch's fault.

--compile adds torch.compile of the same generator (its discriminators stay eager). On a GPU (jax[cuda] and PyTorch's
CUDA build) both run there;
--precision bfloat16 is our `optim.precision` and PyTorch's autocast, in training. --peak is the device's dense TFLOP/s
at that precision (H100 SXM in bfloat16: 989): the share of it that a training step uses is printed, by the operations
that PyTorch's own counter finds in its convolutions.
"""

from __future__ import annotations

import argparse
import gc
import os
import sys
from functools import partial
from itertools import pairwise

# Both must be known before the libraries start their threads.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
if "--one-core" in sys.argv:
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})

import jax
import numpy as np
import torch
from timing import interleave
from torch import nn
from torch.nn import functional as F
from torch.utils.flop_counter import FlopCounterMode

from jaxsim.config import DiscriminatorConfig, Experiment, GeneratorConfig, LossConfig, OptimConfig
from jaxsim.pix2pix import create_state, make_generate, make_train_step

CHANNELS = 40
DEVICE = "cuda" if torch.cuda.is_available() and jax.default_backend() == "gpu" else "cpu"
SIZES = {
    "small": (GeneratorConfig(filters=16, blocks=3), DiscriminatorConfig(filters=16)),
    "half": (GeneratorConfig(filters=32), DiscriminatorConfig(filters=32)),
    "full": (GeneratorConfig(), DiscriminatorConfig()),
}


class Block(nn.Module):
    """Convolution, instance norm, activation, as `jaxsim.pix2pix.layers.ConvBlock`."""

    def __init__(
        self, narrow, wide, size=3, stride=1, padding="reflect", *, spectral=True, norm=True, activation=F.relu
    ):
        super().__init__()
        self.conv = nn.Conv2d(narrow, wide, size, stride, size // 2, padding_mode=padding)
        nn.init.xavier_normal_(self.conv.weight, gain=0.02)
        if spectral:
            self.conv = nn.utils.spectral_norm(self.conv)
        self.norm = nn.InstanceNorm2d(wide, affine=True) if norm else nn.Identity()
        self.activation = activation

    def forward(self, x):
        return self.activation(self.norm(self.conv(x)))


class Residual(nn.Module):
    def __init__(self, channels, spectral):
        super().__init__()
        self.first = Block(channels, channels, spectral=spectral)
        self.second = Block(channels, channels, spectral=spectral, activation=nn.Identity())

    def forward(self, x):
        return x + self.second(self.first(x))


class EncoderDecoder(nn.Module):
    def __init__(self, channels, widths, blocks, out_channels, spectral):
        super().__init__()
        down = [Block(channels, widths[0], 7, spectral=spectral)]
        down += [Block(a, b, stride=2, spectral=spectral) for a, b in pairwise(widths)]
        up = [Residual(widths[-1], spectral) for _ in range(blocks)]
        for a, b in pairwise(widths[::-1]):
            up += [nn.Upsample(scale_factor=2), Block(a, b, spectral=spectral)]
        if out_channels:
            up += [Block(widths[0], out_channels, 7, spectral=False, norm=False, activation=torch.tanh)]
        self.down, self.up = nn.Sequential(*down), nn.Sequential(*up)

    def forward(self, x, coarse=None):
        x = self.down(x)
        return self.up(x if coarse is None else x + coarse)


class Generator(nn.Module):
    def __init__(self, config: GeneratorConfig, *, spectral=True):
        super().__init__()
        widths = [config.filters * 2**i for i in range(config.downsamples + 1)]
        self.coarse = EncoderDecoder(CHANNELS, widths, config.blocks, None, spectral)
        half = config.filters // 2
        self.fine = EncoderDecoder(CHANNELS, [half, 2 * half], config.enhancer_blocks, config.out_channels, spectral)

    def forward(self, x):
        return self.fine(x, self.coarse(F.avg_pool2d(x, 3, 2, 1, count_include_pad=False)))


class Patch(nn.Module):
    def __init__(self, config: DiscriminatorConfig, channels):
        super().__init__()
        widths = [channels, *(min(config.filters * 2**i, config.max_filters) for i in range(config.layers + 1))]
        leaky = nn.LeakyReLU(0.2)
        self.layers = nn.ModuleList(
            Block(a, b, 3, 2 if i < config.layers else 1, "zeros", activation=leaky)
            for i, (a, b) in enumerate(pairwise(widths))
        )
        self.logits = Block(widths[-1], 1, 3, 1, "zeros", norm=False, activation=nn.Identity())

    def forward(self, x):
        features = []
        for layer in self.layers:
            x = layer(x)
            features.append(x)
        return self.logits(x), features


class Discriminator(nn.Module):
    def __init__(self, config: DiscriminatorConfig, channels):
        super().__init__()
        self.scales = nn.ModuleList(Patch(config, channels) for _ in range(config.scales))

    def forward(self, x):
        results = []
        for i, scale in enumerate(self.scales):
            x = F.interpolate(x, scale_factor=0.5, mode="bilinear", align_corners=True) if i else x
            results.append(scale(x))
        return results


def folded(generator: nn.Module, averaged: nn.Module, decay: float) -> None:
    """Moves the averaged generator towards the trained one with spectral norm folded in."""
    with torch.no_grad():
        modules = dict(generator.named_modules())
        for name, module in averaged.named_modules():
            for part, value in module.named_parameters(recurse=False):
                source = modules[name]
                new = getattr(source, part)
                if part == "weight" and hasattr(source, "weight_orig"):
                    matrix = source.weight_orig.flatten(1)
                    new = source.weight_orig / torch.dot(source.weight_u, torch.mv(matrix, source.weight_v))
                value.lerp_(new, 1 - decay)


class TorchTrainer:
    """The training step of `jaxsim.pix2pix.steps` in PyTorch."""

    def __init__(self, generator: GeneratorConfig, discriminator: DiscriminatorConfig, layout, *, precision, compiled):
        torch.manual_seed(0)
        self.g = Generator(generator).to(DEVICE, memory_format=layout)
        self.ema = Generator(generator, spectral=False).to(DEVICE, memory_format=layout)
        self.d = Discriminator(discriminator, CHANNELS + generator.out_channels).to(DEVICE, memory_format=layout)
        self.adams = [torch.optim.Adam(n.parameters(), 2e-4, (0.5, 0.999)) for n in (self.g, self.d)]
        self.cast = torch.autocast(DEVICE, torch.bfloat16, enabled=precision == "bfloat16")
        if compiled:
            # The discriminators stay eager: they run twice before their backward pass, and compiled, the second run
            # overwrites the spectral norm's vectors that the first one's gradient needs.
            self.g.compile()
            self.ema.compile()

    def forward(self, inputs):
        with torch.no_grad():
            self.ema(inputs)
        if DEVICE == "cuda":
            torch.cuda.synchronize()

    def step(self, inputs, target):
        with self.cast:
            return self._step(inputs, target)

    def _step(self, inputs, target):
        adam_g, adam_d = self.adams
        with torch.no_grad():
            fake = self.g(inputs)
        on_fake = self.d(torch.cat([inputs, fake], 1))
        on_real = self.d(torch.cat([inputs, target], 1))
        terms = [F.relu(1 + a).mean() + F.relu(1 - b).mean() for (a, _), (b, _) in zip(on_fake, on_real)]  # noqa: B905
        adam_d.zero_grad()
        (sum(terms) / len(terms)).backward()
        adam_d.step()

        self.d.requires_grad_(False)
        on_fake = self.d(torch.cat([inputs, self.g(inputs)], 1))
        with torch.no_grad():
            on_real = self.d(torch.cat([inputs, target], 1))
        loss = 0
        for (logits, fakes), (_, reals) in zip(on_fake, on_real, strict=True):
            matching = sum(F.l1_loss(a, b) for a, b in zip(fakes, reals, strict=True))
            loss = loss + (10 * matching - logits.mean()) / len(on_fake)
        adam_g.zero_grad()
        loss.backward()
        adam_g.step()
        self.d.requires_grad_(True)
        folded(self.g, self.ema, 0.999)
        return loss.item()


def compare(size: str, batch: int, arguments: argparse.Namespace, layout) -> None:
    generator, discriminator = SIZES[size]
    random = np.random.default_rng(0)
    inputs = random.uniform(-1, 1, (batch, 64, 512, CHANNELS)).astype(np.float32)
    target = random.uniform(-1, 1, (batch, 64, 512, 1)).astype(np.float32)
    weight = np.ones((batch, 64, 512), np.float32)

    optim = OptimConfig(precision=arguments.precision)
    experiment = Experiment(generator=generator, discriminator=discriminator, loss=LossConfig(), optim=optim)
    state = create_state(experiment, CHANNELS, seed=0)
    parameters = jax.tree.map(np.asarray, state.ema)
    data = jax.device_put({"inputs": inputs, "target": target, "weight": weight})
    generate, train_step = make_generate(experiment, CHANNELS), make_train_step(experiment, CHANNELS)
    theirs = [
        torch.from_numpy(a.transpose(0, 3, 1, 2)).to(DEVICE).contiguous(memory_format=layout) for a in (inputs, target)
    ]
    trainers = {
        name: TorchTrainer(generator, discriminator, layout, precision=arguments.precision, compiled=compiled)
        for name, compiled in (("torch", False), ("torch.compile", True))[: 2 if arguments.compile else 1]
    }
    with FlopCounterMode(display=False) as counter:
        trainers["torch"].step(*theirs)
    operations = counter.get_total_flops()

    def forward() -> None:
        jax.block_until_ready(generate(parameters, data["inputs"]))

    def step() -> None:
        nonlocal state
        state, metrics = train_step(state, data)
        jax.block_until_ready((state, metrics))

    parameters = jax.device_put(parameters)
    peers = {"jaxsim": forward} | {name: partial(t.forward, theirs[0]) for name, t in trainers.items()}
    took = interleave(f"generator forward, {size}, batch {batch}, float32", peers, rounds=arguments.rounds, warmup=1)
    _rates(took, batch)
    peers = {"jaxsim": step} | {name: partial(t.step, *theirs) for name, t in trainers.items()}
    title = f"training step, {size}, batch {batch}, {arguments.precision}"
    took = interleave(title, peers, rounds=arguments.rounds, warmup=1)
    _rates(took, batch, operations=operations, peak=arguments.peak)


def _rates(took: dict[str, float], batch: int, *, operations: float = 0.0, peak: float = 0.0) -> None:
    for name, seconds in took.items():
        note = f", {operations / seconds / 1e12:.2f} TFLOP/s" if operations else ""
        note += f" ({100 * operations / seconds / 1e12 / peak:.1f} % of the peak)" if operations and peak else ""
        print(f"  {name:<24}{batch / seconds:10.2f} images/s{note}", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sizes", nargs="*", default=["small", "full"])
    parser.add_argument("--batch", type=int, nargs="*", default=[1, 8])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--channels-last", action="store_true")
    parser.add_argument("--one-core", action="store_true")
    parser.add_argument("--compile", action="store_true")
    parser.add_argument("--precision", choices=("float32", "bfloat16"), default="float32")
    parser.add_argument("--peak", type=float, default=0.0)
    arguments = parser.parse_args()
    torch.set_num_threads(len(os.sched_getaffinity(0)))
    layout = torch.channels_last if arguments.channels_last else torch.contiguous_format
    for size in arguments.sizes:
        for batch in arguments.batch:
            compare(size, batch, arguments, layout)
            gc.collect()
