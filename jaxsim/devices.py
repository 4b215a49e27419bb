"""One mesh over all devices of all processes: each device takes its part of the batch, all hold the same state.

Process 0 alone touches the run's folder; what it reads there goes to the others over the network, so that no
shared disk is needed and a checkpoint fits any number of devices.
"""

from __future__ import annotations

import gc
import logging
import os
import re
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from functools import wraps
from pathlib import Path
from typing import ParamSpec, TypeVar

import jax
import numpy as np
from jax.experimental import multihost_utils
from jax.sharding import AxisType, Mesh, NamedSharding, PartitionSpec
from jaxtyping import PyTree
from threadpoolctl import threadpool_limits

_log = logging.getLogger(__name__)

P = ParamSpec("P")
R = TypeVar("R")
A = TypeVar("A")
B = TypeVar("B")

DATA = "data"
"""The mesh's only axis: the batch is cut along it."""
WHOLE = PartitionSpec()
CUT = PartitionSpec(DATA)
SILENT_S = 20
"""Seconds without a sign of life after which a process counts as dead, and the others end."""
MAPPED = 0.33
"""Share of the memory mappings that a process may have, above which `by_small_steps` lets compiled programs go."""
SELDOM = 100_000
"""Objects made since the last collection after which Python collects garbage next, of `by_small_steps`."""
_OF_ANOTHER = re.compile(r"gloo|nccl|heartbeat|barrier|coordination|connection|UNAVAILABLE|DEADLINE", re.IGNORECASE)
"""What the layers between processes say when one of them is gone."""


def connect() -> None:
    """Joins this process to the others that a launcher started (`jax.distributed`), before any other use of JAX.

    Slurm, Open MPI, Kubernetes and TPU pods are recognised by JAX. Any other launcher names the meeting point in
    JAX_COORDINATOR_ADDRESS (host:port of process 0), JAX_NUM_PROCESSES and JAX_PROCESS_ID. Raises ValueError
    where neither is there.
    """
    given = {name: os.environ.get(name) for name in ("JAX_COORDINATOR_ADDRESS", "JAX_NUM_PROCESSES", "JAX_PROCESS_ID")}
    missing = [name for name, value in given.items() if not value]
    if missing and len(missing) < len(given):
        raise ValueError(f"devices: {', '.join(missing)} not set, though others are; set all of {', '.join(given)}")
    try:
        if missing:
            jax.distributed.initialize(heartbeat_timeout_seconds=SILENT_S)
        else:
            address, count, index = given.values()
            process = int(count or ""), int(index or "")
            jax.distributed.initialize(address, *process, heartbeat_timeout_seconds=SILENT_S)
    except ValueError as error:
        raise ValueError(
            f"devices: no launcher recognised ({error}); start under Slurm, Open MPI, Kubernetes or on a TPU pod, "
            f"set {', '.join(given)} in every process, or leave out --run.distributed"
        ) from error


@contextmanager
def while_all_live() -> Iterator[None]:
    """Raises ValueError with one line where another process ended in the block, for what the layers between them say.

    A process that is silent and whose connections stay open (its machine hangs) ends the others from within JAX.
    """
    try:
        yield
    except jax.errors.JaxRuntimeError as error:
        if jax.process_count() == 1 or not _OF_ANOTHER.search(str(error)):
            raise
        raise ValueError(
            f"devices: process {jax.process_index()} of {jax.process_count()} stops, for another one ended; its own "
            "output says why. Start all of them again: the same command goes on from the last checkpoint"
        ) from error


def data_mesh(batch: int, *, members: int = 1) -> Mesh | None:
    """The mesh that a batch of this size is cut over, each part so that `members` of a network can share it; None where
    one device takes it whole.

    Several processes use all their devices: raises ValueError where the batch cannot be divided among them. One
    process uses the largest number of its devices that divides the batch, and says so if that is not all.
    """
    devices = jax.devices()
    count = len(devices)
    if jax.process_count() > 1:
        if batch % (count * members):
            raise ValueError(
                f"devices: a batch of {batch} cannot be divided among {count} devices of {jax.process_count()} "
                f"processes; make --optim.batch a multiple of {count * members}"
            )
    else:
        used = max((n for n in range(1, count + 1) if batch % (n * members) == 0), default=1)
        if used < count:
            _log.info(f"devices: a batch of {batch} divides among {used} of {count} devices; the others stay idle")
        count = used
    if count == 1:
        return None
    return jax.make_mesh((count,), (DATA,), axis_types=(AxisType.Auto,), devices=devices[:count])


def check_batch(count: int, size: int, parts: int, *, what: str) -> None:
    """Raises ValueError where so many training frames or scenes (`what`) cannot fill a batch, or a batch cannot be
    divided among so many processes."""
    if count < size:
        raise ValueError(f"batches: {count} training {what} cannot fill a batch of {size}; lower --optim.batch")
    if size % parts:
        raise ValueError(
            f"batches: {size} {what} cannot be divided among {parts} processes; make --optim.batch a multiple"
        )


def is_first() -> bool:
    """Whether this is process 0, the one that writes."""
    return jax.process_index() == 0


def by_first(action: Callable[[], None]) -> None:
    """Runs an action on process 0 while the others wait; where it fails, all processes stop.

    Raises on process 0 what the action raised, elsewhere ValueError.
    """
    failure: BaseException | None = None
    if is_first():
        try:
            action()
        except Exception as error:
            failure = error
    failed = bool(multihost_utils.broadcast_one_to_all(np.int32(failure is not None)))
    if failure is not None:
        raise failure
    if failed:
        raise ValueError("devices: process 0 stopped; its own output says why")


def of_first(number: int) -> int:
    """Process 0's number, on every process."""
    return int(multihost_utils.broadcast_one_to_all(np.int32(number)))


def cut(mesh: Mesh | None, part: PyTree) -> PyTree:
    """This process's part of a batch as the batch of all: arrays cut along their first axis over the mesh."""
    if mesh is None:
        return part
    sharding = NamedSharding(mesh, CUT)
    return jax.tree.map(lambda x: jax.make_array_from_process_local_data(sharding, np.asarray(x)), part)


def everywhere(mesh: Mesh | None, tree: PyTree) -> PyTree:
    """Process 0's values, whole on every device. The other processes give a tree of the same shapes."""
    if mesh is None:
        return tree
    sharding = NamedSharding(mesh, WHOLE)
    if jax.process_count() == 1:
        return jax.device_put(tree, sharding)
    values = multihost_utils.broadcast_one_to_all(tree)
    return jax.tree.map(lambda x: jax.make_array_from_process_local_data(sharding, x, x.shape), values)


def nearby(tree: PyTree) -> PyTree:
    """Arrays that every device holds whole, as those of this process's first device."""
    return jax.tree.map(lambda x: x.addressable_data(0) if isinstance(x, jax.Array) else x, tree)


def to_host(tree: PyTree) -> PyTree:
    """NumPy arrays of the whole values; where they are cut over processes, all processes have to ask."""

    def fetch(x: jax.Array | np.ndarray | np.generic | float) -> np.ndarray:
        if isinstance(x, jax.Array) and not (x.is_fully_addressable or x.is_fully_replicated):
            return np.asarray(multihost_utils.process_allgather(x, tiled=True))
        return np.asarray(x)

    return jax.tree.map(fetch, tree)


def wait(name: str) -> None:
    """Waits until every process has come to this place."""
    if jax.process_count() > 1:
        multihost_utils.sync_global_devices(name)


def by_small_steps(function: Callable[P, R]) -> Callable[P, R]:
    """Decorator of what runs thousands of small programs in turn with NumPy, and waits for each.

    It computes on the CPU wherever JAX has one: a GPU begins such a program later than a CPU ends it, and adds up in no
    fixed order (docs/benchmarks.md). JAX_PLATFORMS=cuda leaves JAX no CPU. NumPy's linear algebra is on one thread, for
    BLAS's threads spin against XLA's for the same cores. Garbage is collected seldom: the collector goes through all
    that JAX made of its programs, again and again, and finds little. One that is called again and again with arrays of
    ever other shapes lets its programs go before they are too many.
    """

    @wraps(function)
    def run(*args: P.args, **named: P.kwargs) -> R:
        let_programs_go()
        with _on_cpu(), _seldom_collected(), threadpool_limits(limits=1, user_api="blas"):
            return function(*args, **named)

    return run


def let_programs_go() -> None:
    """Lets compiled programs go where this process holds so many that it could soon hold no more.

    On a CPU each takes about eighteen mappings of memory, of which Linux gives a process 65530 (vm.max_map_count), and
    LLVM ends a process that asks for more. What is needed again comes from the cache on disk, or is compiled anew.
    """
    try:
        most = int(Path("/proc/sys/vm/max_map_count").read_text())
        held = Path("/proc/self/maps").read_bytes().count(b"\n")
    except OSError:  # not Linux's
        return
    if held > MAPPED * most:
        jax.clear_caches()


def side_by_side(first: Callable[[], A], second: Callable[[], B]) -> tuple[A, B]:
    """What two actions give that wait for nothing of each other, each in a thread of its own: programs and NumPy's
    large steps leave Python to the other. Raises what the first raised, or else the second."""
    with ThreadPoolExecutor(1) as pool:
        future = pool.submit(second)
        return first(), future.result()


@contextmanager
def _seldom_collected() -> Iterator[None]:
    before = gc.get_threshold()
    gc.set_threshold(SELDOM, *before[1:])
    try:
        yield
    finally:
        gc.set_threshold(*before)


@contextmanager
def _on_cpu() -> Iterator[None]:
    cpu = None
    if jax.default_backend() != "cpu":
        with suppress(RuntimeError):  # JAX_PLATFORMS names no CPU
            cpu = jax.local_devices(backend="cpu")[0]
    if cpu is None:
        yield
        return
    before = jax.config.jax_default_device  # type: ignore[attr-defined]  # jax declares no types of its settings
    # Of the process, for a thread that is begun within knows nothing of a context.
    jax.config.update("jax_default_device", cpu)
    try:
        with jax.default_device(cpu):
            yield
    finally:
        jax.config.update("jax_default_device", before)
