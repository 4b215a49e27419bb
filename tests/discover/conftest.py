from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np
import pytest

from jaxsim.discover.model.evidence import Evidence, gather
from jaxsim.discover.read import Comparison
from jaxsim.discover.regimes.find import Divided, find_regimes
from jaxsim.discover.stages.ask import Asked, ask
from jaxsim.discover.stages.complete import Completed, complete
from jaxsim.discover.stages.conclude import Shown, show
from jaxsim.discover.stages.place import Placed, place
from jaxsim.effects import get_effect
from jaxsim.effects.chain import SensorModel
from tests.discover.few_rays import looking_at
from tests.discover.toy import FAR_M, device, toy
from tests.quick import quickly_compiled

STREETS = 12
LARGE = (
    *("model/test_smooth.py", "name/test_other_sides.py", "read/test_checks.py", "read/test_control.py"),
    *("regimes/test_find.py", "repeats/test_examine.py", "test_add.py", "test_contrast.py", "test_division.py"),
    *("test_levels.py", "test_few_drives.py", "test_read.py", "test_workflow.py", "unpaired/test_workflow.py"),
)
"""Files whose drives are large, or fitted often: LLVM's work on what casts and fits them is worth its time there."""


@pytest.fixture(scope="module", autouse=True)
def programs(request: pytest.FixtureRequest):
    """Compiles what fits toys quickly."""
    if request.path.relative_to(Path(__file__).parent).as_posix() not in LARGE:
        request.getfixturevalue("quick_programs")


@pytest.fixture(scope="module")
def few_rays():
    """Fits look at half as many rays as usual."""
    with looking_at(1 / 2):
        yield


@pytest.fixture
def few_rays_here():
    """The same for one test of a file whose others need all."""
    with looking_at(1 / 2):
        yield


@pytest.fixture(scope="module")
def evidence() -> Evidence:
    scan, measured = toy()
    frames = np.arange(6)
    columns = np.broadcast_to(np.arange(0, 60, 4), (6, 15))
    return gather(*device(scan, measured), frame=frames, column=columns, scene=frames)


class Stages(NamedTuple):
    """What each stage of the way gives of one comparison."""

    placed: Placed
    asked: Asked
    divided: Divided
    completed: Completed
    shown: Shown


@pytest.fixture(scope="session")
def stages() -> Stages:
    """Twelve streets whose sensor reads ranges too far by FAR_M, asked for two effects, beside a loss that is known."""
    scan, measured = toy(frames=STREETS)
    measured = replace(measured, range_m=np.where(measured.valid, measured.range_m + np.float32(FAR_M), 0))
    names = tuple(f"{k:02d}" for k in range(STREETS))
    catalogue = [get_effect(name) for name in ("range_offset", "incidence_cosine")]
    known = SensorModel((("random_dropout", {"probability": 0.01}),))
    # For the session, which `standard_promotion` is not for. Ranges are wrong by four standard deviations: few show it.
    with (
        looking_at(1 / 4),
        quickly_compiled(),
        jax.numpy_dtype_promotion("standard"),
        jax.numpy_rank_promotion("allow"),
    ):
        placed = place(Comparison(scan, measured, names, names), catalogue, known, log=lambda line: None)
        asked = ask(placed, nulls=0, log=lambda line: None)
        divided = find_regimes(placed.found.null_model, asked.answer, without=asked.without, log=lambda line: None)
        completed = complete(asked.placed.found, divided, asked.others, log=lambda line: None)
        shown = show(asked, completed, every_frame=False, log=lambda line: None)
    return Stages(placed, asked, divided, completed, shown)
