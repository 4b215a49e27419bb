"""Programs that tests start, as a user does: started, waited for, and ended whatever becomes of the test."""

import argparse
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path

ROOT = Path(__file__).parents[1]
SMALL = [
    "--prepare.columns=64", "--prepare.network-size", "64", "128",
    "--generator.filters=4", "--generator.blocks=1", "--generator.downsamples=2", "--generator.enhancer-blocks=1",
    "--discriminator.filters=4", "--discriminator.max-filters=8", "--discriminator.scales=1",
    "--discriminator.layers=1",
]  # fmt: skip
"""Flags of networks that learn in seconds."""
TINY = [
    "--data.train=0-1", "--data.validation=2-2", *SMALL, "--optim.batch=2", "--optim.steps=2", "--optim.ema-start=1",
    "--run.name=tiny",
]  # fmt: skip
"""Flags of two steps of a training."""
_OLDER = (
    ("--xla_cpu_use_fusion_emitters=false", "--xla_cpu_parallel_codegen_split_count=1")
    if version("jaxlib").startswith(("0.10.", "0.11.0"))
    else ()
)
QUICK = ("--xla_backend_optimization_level=1", *_OLDER)
"""What tests run is small: LLVM would work on it longer than it saves, and on what the newer emitters write longest.
Parts of a program that threads compile are more work together than the whole, and both workers have a core each.
From 0.11.1 on there are no other emitters, and a flag that XLA does not know ends the process."""
DEVICES = "--xla_force_host_platform_device_count"
PATIENCE_S = 3600.0
"""The slowest program here takes two minutes on a quiet machine; a busy one may take thirty times as long."""


def with_flags(given: str, *flags: str) -> str:
    """The flags of XLA that were given, with those of these that were not: `--xla_cpu_max_isa=AVX2` leaves all else as
    it is."""
    names = {flag.partition("=")[0] for flag in given.split()}
    return " ".join([*(flag for flag in flags if flag.partition("=")[0] not in names), *given.split()])


def environment(**variables: str) -> dict[str, str]:
    """On the CPU, one device, with all tests' compiled programs; jaxsim is this checkout's. All other flags of XLA are
    those of the tests' own process, so that a program's answers are, too, bit for bit."""
    given = [flag for flag in os.environ.get("XLA_FLAGS", "").split() if not flag.startswith(DEVICES)]
    own = {"JAX_PLATFORMS": "cpu", "XLA_FLAGS": with_flags(" ".join(given), *QUICK), "PYTHONPATH": str(ROOT)}
    return {**os.environ, **own, **variables}


@contextmanager
def running(work: Path, *command: str | Path, **variables: str) -> Iterator[subprocess.Popen[str]]:
    """A Python program at work in a folder, its output and errors one stream; killed at the end if it still runs."""
    process = subprocess.Popen(
        [sys.executable, *map(str, command)],
        cwd=work,
        env=environment(**variables),
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
    )
    with process:  # closes its pipe
        try:
            yield process
        finally:
            process.kill()


def said(work: Path, *command: str | Path, fails: bool = False, **variables: str) -> str:
    """What a program said that ended well, or, where it `fails`, with a message and no traceback."""
    with running(work, *command, **variables) as process:
        output = process.communicate(timeout=PATIENCE_S)[0]
    assert bool(process.returncode) == fails, output
    assert not fails or "Traceback" not in output, output
    return output


def wait_until(true: Callable[[], bool], process: subprocess.Popen[str]) -> None:
    """Waits for something that a running program does. Fails where the program ends before."""
    deadline = time.monotonic() + PATIENCE_S
    while not true():
        assert time.monotonic() < deadline
        assert process.poll() is None, process.communicate()[0]
        time.sleep(0.02)


def processor_s(process: int) -> float:
    """Seconds of processor time of a process and of those that it has waited for; 0 of one that is gone. Linux's."""
    try:
        fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return sum(map(int, fields[11:15])) / os.sysconf("SC_CLK_TCK")


def peak_mb() -> int:
    """Megabytes that this process has held at most since its program began. Linux's.

    `getrusage` begins with what the process held that started it: in a test's program, more than most programs take.
    """
    held = next(line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmHWM:"))
    return int(held.split()[1]) // 1024


def at_least(least: int) -> Callable[[str], int]:
    """The type of an argument of a program: a whole number, not below `least`."""

    def number(text: str) -> int:
        # `int` takes 1_0 for ten, too.
        if not text.isascii() or not text.isdecimal() or int(text) < least:
            raise argparse.ArgumentTypeError(f"is {text}; it must be a whole number, {least} or more")
        return int(text)

    return number
