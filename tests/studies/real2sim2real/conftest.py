import pytest

from jaxsim.studies.real2sim2real.settings import Loop
from tests.studies.real2sim2real.made import scored_loop


@pytest.fixture
def scored(tmp_path) -> Loop:
    return scored_loop(tmp_path / "loop")
