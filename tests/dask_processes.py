"""A Dask scheduler and its workers as processes of their own, as on machines of their own."""

import re
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from tests.programs import PATIENCE_S, environment


@dataclass
class Processes:
    """They are killed when the test ends."""

    work: Path
    stack: ExitStack
    address: str = ""

    def start(self, program: str, *arguments: str) -> subprocess.Popen[bytes]:
        """`dask scheduler` or `dask worker`, which writes its log to `work`."""
        log = (self.work / f"{program}-{time.monotonic_ns()}.log").open("wb")
        process = subprocess.Popen(
            [sys.executable, "-m", f"distributed.cli.dask_{program}", *arguments],
            cwd=self.work,
            # So long may a busy machine keep a worker from telling that it lives; after that it is given up.
            env=environment(DASK_DISTRIBUTED__SCHEDULER__WORKER_TTL="30s"),
            stdout=log,
            stderr=subprocess.STDOUT,
        )
        self.stack.callback(log.close)
        self.stack.callback(process.wait)
        self.stack.callback(process.kill)
        return process

    def worker(self) -> subprocess.Popen[bytes]:
        """One more worker, of one thread; nobody starts it again when it dies."""
        return self.start("worker", self.address, "--nthreads", "1", "--no-nanny", "--no-dashboard")


@contextmanager
def processes(work: Path) -> Iterator[Processes]:
    """A scheduler, and `worker()` to add workers."""
    with ExitStack() as stack:
        found = Processes(work, stack)
        scheduler = found.start("scheduler", "--host", "127.0.0.1", "--port", "0", "--dashboard-address", ":0")
        deadline = time.monotonic() + PATIENCE_S
        while not found.address:
            assert time.monotonic() < deadline
            assert scheduler.poll() is None
            text = "".join(path.read_text() for path in work.glob("scheduler-*.log"))
            match = re.search(r"tcp://127\.0\.0\.1:\d+", text)
            found.address = match[0] if match else ""
            time.sleep(0.05)
        yield found
