"""`jaxsim doctor`: what a bug report needs to know of a machine, and whether a sample run works on it."""

from __future__ import annotations

from dataclasses import dataclass

from jaxsim.doctor import check_needs, facts, sample_run


@dataclass(frozen=True)
class Doctor:
    """Tells versions, devices, the cache and the extras that are installed, and makes a sample run.

    Copy what it prints into a bug report: it names no data of yours. Ends with 1 where something that jaxsim needs is
    missing or the sample run fails.
    """

    run: bool = True
    """Simulate one frame with the packaged sensor, in about ten seconds; --no-run leaves it out."""

    def __call__(self) -> None:
        print("\n".join(f"{name + ':':<12}{value}" for name, value in facts()), flush=True)
        check_needs()
        if self.run:
            print(f"{'sample run:':<12}", end="", flush=True)
            print(sample_run())
