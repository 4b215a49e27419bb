import pytest

from jaxsim.studies.real2sim2real import Loop
from tests.studies.real2sim2real.made import scored_loop


@pytest.fixture
def scored(tmp_path) -> Loop:
    return scored_loop(tmp_path / "loop")
