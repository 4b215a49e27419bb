"""Times peers in turn (A B A B ...), so that a machine whose speed drifts is fair to both."""

import time
from collections.abc import Callable
from statistics import median


def interleave(
    title: str, peers: dict[str, Callable[[], object]], *, rounds: int = 15, warmup: int = 2
) -> dict[str, float]:
    """Prints the median milliseconds of each peer and its ratio to the first; returns the medians in seconds.

    Each callable must have finished its work when it returns (`jax.block_until_ready`).
    """
    for _ in range(warmup):
        for run in peers.values():
            run()
    seconds: dict[str, list[float]] = {name: [] for name in peers}
    for _ in range(rounds):
        for name, run in peers.items():
            start = time.perf_counter()
            run()
            seconds[name].append(time.perf_counter() - start)
    medians = {name: median(values) for name, values in seconds.items()}
    first = next(iter(medians))
    print(f"\n{title}  (median of {rounds}, interleaved)")
    for name, value in medians.items():
        ratios = median(b / a for a, b in zip(seconds[first], seconds[name], strict=True))
        note = "" if name == first else f"   {name} takes {ratios:.2f} x the time of {first}"
        print(f"  {name:<24}{value * 1e3:10.3f} ms{note}", flush=True)
    return medians
