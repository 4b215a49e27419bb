"""Times peers in turn (A B A B ...), so that a machine whose speed drifts is fair to both."""

import time
from collections.abc import Callable
from statistics import median


def interleave(
    title: str, peers: dict[str, Callable[[], object]], *, rounds: int = 15, warmup: int = 2
) -> dict[str, float]:
    """Prints the median milliseconds of each peer and its ratio to the first, and the processor time of both over all
    threads, which other work on the machine changes less; returns the medians in seconds.

    Each callable must have finished its work when it returns (`jax.block_until_ready`).
    """
    for _ in range(warmup):
        for run in peers.values():
            run()
    seconds: dict[str, list[float]] = {name: [] for name in peers}
    processor: dict[str, list[float]] = {name: [] for name in peers}
    for _ in range(rounds):
        for name, run in peers.items():
            start = time.perf_counter(), time.process_time()
            run()
            seconds[name].append(time.perf_counter() - start[0])
            processor[name].append(time.process_time() - start[1])
    medians = {name: median(values) for name, values in seconds.items()}
    first = next(iter(medians))
    print(f"\n{title}  (median of {rounds}, interleaved)")
    for name, value in medians.items():
        ratios = [
            median(b / max(a, 1e-9) for a, b in zip(each[first], each[name], strict=True))
            for each in (seconds, processor)
        ]
        note = "" if name == first else f"   {ratios[0]:.2f} x the time of {first}, {ratios[1]:.2f} x its processor's"
        print(
            f"  {name:<24}{value * 1e3:10.3f} ms, processor {median(processor[name]) * 1e3:10.3f} ms{note}", flush=True
        )
    return medians
