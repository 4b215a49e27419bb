"""How much of the embedded world's intensity can be learned: `python benchmarks/studies/learnable.py [FRAMES]`.

Mean absolute error, over the rays that came back within 40 degrees of straight ahead, of averages of the same
rays and of the noise-free truth: no network can beat the last.
"""

import sys

import numpy as np

from jaxsim.data import open_dataset


def main(frames: int) -> None:
    world = open_dataset("synthetic")
    intensity, exact, group = [], [], []
    for i in range(0, 4 * frames, 4):
        truth = world.truth(i)
        measured = world.measure(i, truth)
        ahead = np.abs(np.asarray(world.grid.azimuth_rad)) < np.deg2rad(40)
        counts = np.asarray(measured.valid) & ahead
        rows = np.broadcast_to(np.arange(len(counts))[:, None], counts.shape)
        intensity.append(np.asarray(measured.intensity)[counts])
        exact.append(np.asarray(truth.image.intensity)[counts])
        group.append(np.stack([np.zeros(counts.sum(), int), np.asarray(truth.scan.semantic)[counts], rows[counts]]))
    y, x, groups = np.concatenate(intensity), np.concatenate(exact), np.concatenate(group, axis=1)
    print(f"{frames} streets, {y.size} rays")
    for name, g in zip(("global mean", "per-class mean", "per-row mean"), groups, strict=True):
        mean = np.bincount(g, y) / np.maximum(np.bincount(g), 1)
        print(f"  {name:<18}{np.abs(y - mean[g]).mean():.4f}")
    print(f"  {'noise-free truth':<18}{np.abs(y - x).mean():.4f}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 40)
