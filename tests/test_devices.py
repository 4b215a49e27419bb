"""Devices that share a batch: virtual ones of one process, and those of two processes on this machine."""

import gc
import json
import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from jaxsim import devices
from jaxsim.devices import by_small_steps, side_by_side
from tests.programs import DEVICES, PATIENCE_S, QUICK, with_flags

pytestmark = pytest.mark.long

ROOT = Path(__file__).parents[1]
STEPS = 4


@contextmanager
def started(*args: object, count: int, **variables: object) -> Iterator[subprocess.Popen[str]]:
    """A process of `small_training`, killed at the end if it still runs."""
    flags = with_flags(f"{DEVICES}={count}", *QUICK)
    environment = {**os.environ, "JAX_PLATFORMS": "cpu", "XLA_FLAGS": flags, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "tests.small_training", *map(str, args)]
    process = subprocess.Popen(
        command,
        cwd=ROOT,
        env=environment | {name: str(value) for name, value in variables.items()},
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    with process:
        try:
            yield process
        finally:
            process.kill()


def lines(process: subprocess.Popen[str]) -> list[dict[str, float]]:
    """What a process printed of each step."""
    output, errors = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0, errors
    return [json.loads(line) for line in output.splitlines() if line.startswith("{")]


@contextmanager
def two_started(folders: list[Path], *args: object) -> Iterator[list[subprocess.Popen[str]]]:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{free.getsockname()[1]}"
    common = {"JAX_COORDINATOR_ADDRESS": address, "JAX_NUM_PROCESSES": 2}
    with ExitStack() as both:
        yield [
            both.enter_context(started(folder, *args, "--distributed", count=1, JAX_PROCESS_ID=i, **common))
            for i, folder in enumerate(folders)
        ]


@pytest.fixture(scope="module")
def work(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("devices")


@pytest.fixture(scope="module")
def one_device(work) -> list[dict[str, float]]:
    with started(work / "one", STEPS, STEPS, count=1) as process:
        return lines(process)


@pytest.fixture(scope="module")
def four_devices(work) -> list[dict[str, float]]:
    """Saves a checkpoint after two steps."""
    with started(work / "four", STEPS, 2, count=4) as process:
        return lines(process)


@pytest.fixture(scope="module")
def two_processes(work, four_devices) -> list[list[dict[str, float]]]:
    """They go on from the four devices' checkpoint, which only the first of them can see."""
    with two_started([work / "four", work / "nowhere"], STEPS, STEPS) as both:
        return [lines(process) for process in both]


def agree(ours: dict[str, float], alone: dict[str, float]) -> None:
    assert set(ours) == set(alone)
    for name, value in alone.items():
        if name.startswith("loss/") or name in ("lr", "batch"):
            np.testing.assert_allclose(ours[name], value, rtol=1e-5, atol=1e-6, err_msg=f"{name}, step {ours['step']}")
        elif name.startswith("grad_norm/"):
            np.testing.assert_allclose(ours[name], value, rtol=1e-4, err_msg=name)


def test_four_devices_lose_what_one_loses(one_device, four_devices):
    assert [line["devices"] for line in four_devices] == [4] * STEPS
    for ours, alone in zip(four_devices, one_device, strict=True):
        agree(ours, alone)


def test_two_processes_go_on_from_the_checkpoint_of_four_devices(one_device, two_processes):
    for process in two_processes:
        assert [(line["step"], line["devices"]) for line in process] == [(3, 2), (4, 2)]
        for ours, alone in zip(process, one_device[2:], strict=True):
            agree(ours, alone)


@pytest.mark.slow
@pytest.mark.parametrize("killed", [0, 1])
def test_a_process_that_is_killed_ends_the_other_with_one_line(work, killed):
    with two_started([work / f"killed{killed}", work / "nowhere"], 100_000, 100_000) as processes:
        for process in processes:
            assert process.stdout is not None
            assert any(line.startswith("{") for line in process.stdout), "no step was made"
        processes[killed].kill()
        begun = time.monotonic()
        _, errors = processes[1 - killed].communicate(timeout=PATIENCE_S)
        took_s = time.monotonic() - begun
        processes[killed].communicate()
    assert processes[1 - killed].returncode != 0
    (line,) = (line for line in errors.splitlines() if line.startswith("ValueError: devices: "))
    assert f"process {1 - killed} of 2 stops, for another one ended" in line
    assert took_s < 30


def test_an_error_of_ones_own_is_not_anothers(monkeypatch):
    monkeypatch.setattr(jax, "process_count", lambda: 2)
    with pytest.raises(jax.errors.JaxRuntimeError, match="EXHAUSTED"), devices.while_all_live():
        raise jax.errors.JaxRuntimeError("RESOURCE_EXHAUSTED: out of memory")
    with pytest.raises(ValueError, match="process 0 of 2 stops, for another one ended"), devices.while_all_live():
        raise jax.errors.JaxRuntimeError("INTERNAL: Gloo all-reduce failed: Connection closed by peer")
    monkeypatch.setattr(jax, "process_count", lambda: 1)
    with pytest.raises(jax.errors.JaxRuntimeError, match="Gloo"), devices.while_all_live():
        raise jax.errors.JaxRuntimeError("INTERNAL: Gloo")


def test_only_the_first_process_writes(work, two_processes):
    assert sorted(path.name for path in (work / "four" / "checkpoints").iterdir()) == ["2", "4"]
    assert not (work / "nowhere").exists()


def test_a_batch_goes_to_as_many_devices_as_divide_it(capsys):
    if jax.device_count() != 2:
        pytest.skip(f"{jax.device_count()} devices, not 2")
    mesh = devices.data_mesh(4)
    assert mesh is not None
    assert mesh.size == 2
    assert devices.data_mesh(3) is None
    assert "a batch of 3 divides among 1 of 2 devices" in capsys.readouterr().out
    assert devices.data_mesh(2, members=2) is None  # each device is to have an item for each
    shared = devices.data_mesh(4, members=2)
    assert shared is not None
    assert shared.size == 2


def test_a_launcher_that_says_half_is_told_the_other_half(monkeypatch):
    monkeypatch.setenv("JAX_COORDINATOR_ADDRESS", "127.0.0.1:1")
    monkeypatch.delenv("JAX_NUM_PROCESSES", raising=False)
    monkeypatch.setenv("JAX_PROCESS_ID", "0")
    with pytest.raises(ValueError, match="JAX_NUM_PROCESSES not set"):
        devices.connect()


def test_nothing_reaches_for_devices_before_the_processes_have_met():
    """`jax.distributed` must come first, and importing all of the program must not use JAX."""
    code = "import train; from jax._src import xla_bridge; assert not xla_bridge.backends_are_initialized()"
    subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True, env={**os.environ, "PYTHONPATH": str(ROOT)})


def test_garbage_is_collected_seldom_inside_and_as_before_after():
    before = gc.get_threshold()
    assert by_small_steps(gc.get_threshold)()[0] == devices.SELDOM
    assert gc.get_threshold() == before


@pytest.mark.skipif(not Path("/proc/self/maps").exists(), reason="mappings are told by Linux alone")
@pytest.mark.parametrize("share", [0.0, 1.0])
def test_programs_are_let_go_before_they_are_too_many_to_hold(share, monkeypatch):
    """What is answered in one process of ever other shapes would end it: LLVM finds no room for another program."""
    double = jax.jit(lambda x: 2 * x)
    double(jnp.ones(3))
    monkeypatch.setattr(devices, "MAPPED", share)

    @by_small_steps
    def held() -> int:
        return double._cache_size()

    assert held() == int(share)
    assert float(double(jnp.ones(3)).sum()) == 6


def blas_threads() -> list[int]:
    return [pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"]


def test_blas_has_one_thread_inside_and_as_many_as_before_after_an_error():
    inside = []

    @by_small_steps
    def solve():
        inside.extend(blas_threads())
        raise ArithmeticError

    with threadpool_limits(2, user_api="blas"):
        before = blas_threads()
        with pytest.raises(ArithmeticError):
            solve()
        after = blas_threads()
    assert before, "NumPy without a BLAS that threadpoolctl knows"
    assert set(before) == {2}
    assert set(inside) == {1}
    assert after == before


@pytest.mark.parametrize("has_cpu", [True, False])
def test_small_steps_are_on_the_cpu_where_there_is_one_beside_an_accelerator(has_cpu, monkeypatch):
    cpu, accelerator = jax.devices()[:2]  # of the tests' two CPUs the second stands for a GPU
    monkeypatch.setattr(jax, "default_backend", lambda: "gpu")
    if not has_cpu:

        def none(backend: str) -> None:
            raise RuntimeError(f"Unknown backend {backend}")

        monkeypatch.setattr(jax, "local_devices", none)

    def place():
        return jnp.zeros(3).devices()

    @by_small_steps
    def places():
        with ThreadPoolExecutor(1) as pool:
            return [place(), pool.submit(place).result()]

    jax.config.update("jax_default_device", accelerator)
    try:
        assert places() == 2 * [{cpu if has_cpu else accelerator}]
        assert place() == {accelerator}
    finally:
        jax.config.update("jax_default_device", None)


def test_two_actions_run_side_by_side_and_give_what_each_gives():
    met = threading.Barrier(2, timeout=60)

    def first():
        met.wait()  # passed only while the other runs
        return "first"

    def second():
        met.wait()
        return 2

    assert side_by_side(first, second) == ("first", 2)


def test_of_two_actions_that_fail_the_first_one_is_told():
    def fails(words):
        raise ValueError(words)

    with pytest.raises(ValueError, match="of the first"):
        side_by_side(lambda: fails("of the first"), lambda: fails("of the second"))
    with pytest.raises(ValueError, match="of the second"):
        side_by_side(lambda: 1, lambda: fails("of the second"))
