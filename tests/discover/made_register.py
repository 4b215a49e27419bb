"""What tests of register are made of."""

import numpy as np

from tests.discover.rooms import registered, rooms, seen

FRAMES = 12
NAMES = [f"s{k}" for k in range(FRAMES)]


def found(poses, *, driven: float | np.ndarray = 0.0, **more):
    rng = np.random.default_rng(1)
    poses = np.broadcast_to(poses, (FRAMES, 6))
    ways = np.broadcast_to(driven, FRAMES)
    streets = rooms(FRAMES)
    ours = [seen(room) for room in streets]
    theirs = [seen(r, p, driven=s, noise_m=0.02, rng=rng, **more) for r, p, s in zip(streets, poses, ways, strict=True)]
    return registered(ours, theirs, NAMES)
