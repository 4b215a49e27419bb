"""Shapes and types of every public signature are checked at run time, here and only here."""

import ctypes
import gc
import os
import signal
import sys
from pathlib import Path

from tests.programs import DEVICES, QUICK, with_flags

# A shell starts what runs in its background deaf to Ctrl-C, and so would be every program that a test interrupts.
signal.signal(signal.SIGINT, signal.default_int_handler)
# Rewritten tests, checked modules and libraries installed without bytecode would be compiled anew by both workers and
# by every program that a test starts.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
# Tracing makes many objects that live for some thousands of others: at Python's 700 nearly all grow old.
gc.set_threshold(20_000, 10, 10)
os.environ.setdefault("JAX_PLATFORMS", "cpu")
os.environ["XLA_FLAGS"] = with_flags(os.environ.get("XLA_FLAGS", ""), f"{DEVICES}=2", *QUICK)
# Both workers, programs that tests start, and whatever comes after `few_programs` compile many of the same programs:
# each is kept here once, from run to run too.
os.environ["JAX_COMPILATION_CACHE_DIR"] = str(Path(__file__).parents[1] / ".cache" / "tests")
os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0"

from jaxtyping import install_import_hook

import tests.typechecker  # noqa: F401  (the hook finds it as an attribute of the package)

ROOMS = Path(__file__).parents[1] / "jaxsim"
# frame.py and rays.py hold structs and no kernels, and are left out: those are also built by tree operations, with
# leaves that are no arrays. Settings (config) check themselves, of lists and texts that they make tuples and paths of.
# Of `jaxsim.effects`, a prefix of all its files, the files are named.
UNCHECKED = ("jaxsim.frame", "jaxsim.config", "jaxsim.effects", "jaxsim.effects.rays")
CHECKED = [
    name
    for room in ("jaxsim", "jaxsim.effects")
    for path in sorted((ROOMS.parent / room.replace(".", "/")).glob("[a-z]*"))
    if (name := f"{room}.{path.stem}") not in UNCHECKED
]
install_import_hook(CHECKED, "tests.typechecker.check")

import jax
import pytest

from jaxsim.cli.console import tell_on_console
from tests.data.fixtures import (  # noqa: F401  (trees of data sets, for all folders)
    object_root,
    raw_root,
    step_root,
    step_run,
    step_tree,
    street,
    virtual,
    virtual_root,
)
from tests.quick import quickly_compiled

jax.config.update("jax_numpy_rank_promotion", "raise")
jax.config.update("jax_numpy_dtype_promotion", "strict")

MOST_MAPPINGS = 12_000
MOST_BYTES = 5 * 2**28
"""Of the memory that a process holds at a module's end: what most modules add leaves it below two gibibytes."""
NEEDY = (
    *("train/test_depth.py", "prepare/denoise/lidia/test_denoiser.py", "cli/test_grain.py"),
    *("discover/name/test_other_sides.py", "discover/name/test_simulator_contrast.py"),
)
"""Files that take up to a gibibyte more themselves: what was there before is let go before them."""
DEAREST = (
    *("train/test_intensity.py", "benchmarks/test_blind.py", "discover/name/test_other_sides.py"),
    *("discover/test_workflow.py", "train/test_depth.py", "cli/test_endings.py", "test_devices.py"),
    *("discover/show/test_every_frame.py", "pix2pix/test_golden_training.py", "discover/regimes/test_find.py"),
    *("cli/test_prepare.py", "discover/test_show.py", "discover/name/test_look_alikes.py", "cli/test_effects.py"),
)
"""Files of half a minute and more. They begin first (`make test` and `make test-long` keep this order), so that no
worker waits at the end for another that has just begun with one."""
STATE = Path("/proc/self")
SAMPLES = Path(os.environ.get("JAXSIM_SAMPLE_DATA", Path(__file__).parents[2] / "shared" / "data"))


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Puts the tests of the dearest files first."""
    tests = Path(__file__).parent
    place = {tests / name: k for k, name in enumerate(DEAREST)}
    items.sort(key=lambda item: place.get(item.path, len(DEAREST)))


@pytest.fixture(scope="session")
def samples() -> Path:
    """Real sensor frames and golden vectors; tests that need them are skipped where they are not."""
    if not SAMPLES.is_dir():
        pytest.skip(f"no sample data at {SAMPLES}; set JAXSIM_SAMPLE_DATA to the folder that holds kitti_raw/")
    return SAMPLES


@pytest.fixture(scope="session", autouse=True)
def console():
    """Commands tell on the console what the library logs, also where a test calls them directly."""
    tell_on_console()


@pytest.fixture(scope="session")
def golden(samples: Path) -> Path:
    return samples / "golden"


@pytest.fixture(scope="module", autouse=True)
def few_programs(request: pytest.FixtureRequest):
    """Lets compiled programs go before there are too many.

    Each takes about eighteen mappings of memory. Linux gives a process 65530 (vm.max_map_count), and one that asks for
    more while it compiles ends with a segmentation fault. They hold memory, too, a small one a megabyte and a half, and
    what the compiler has freed stays with the process until it is given back.
    """
    if request.path.relative_to(Path(__file__).parent).as_posix() in NEEDY:
        let_go(above=MOST_BYTES // 2)
    yield
    let_go(above=MOST_BYTES)


def let_go(*, above: int) -> None:
    """Compiled programs, where the process holds more bytes than this, or too many mappings."""
    if not STATE.exists():
        return
    give_back()
    mappings = (STATE / "maps").read_bytes().count(b"\n")
    held = int((STATE / "statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    if mappings > MOST_MAPPINGS or held > above:
        jax.clear_caches()
        give_back()


def give_back() -> None:
    """Hands freed memory to the system, where the C library can (glibc's)."""
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)


@pytest.fixture(scope="module")
def quick_programs():
    """Compiles what a module's tests need as quickly as can be, where that takes most of their time."""
    with quickly_compiled():
        yield


@pytest.fixture(scope="module")
def standard_promotion():
    """SciPy's and NumPy's float64 meet the kernels' float32 here."""
    with jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"):
        yield


@pytest.fixture(scope="module")
def scheduler():
    """Address of a Dask scheduler with two workers, all of them threads of this process, that speak TCP.

    It ends with the module: a scheduler that waits still draws from Python's random state, which hypothesis takes for a
    strategy of the test beside it.
    """
    distributed = pytest.importorskip("distributed", reason="Dask is not installed: pip install -e '.[dask]'")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=False, protocol="tcp", host="127.0.0.1", dashboard_address=":0"
    ) as cluster:
        yield cluster.scheduler_address
