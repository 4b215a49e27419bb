import numpy as np
import pytest

from jaxsim.discover.model.evidence import Evidence, gather
from tests.discover.toy import device, toy


@pytest.fixture(scope="module")
def evidence() -> Evidence:
    scan, measured = toy()
    frames = np.arange(6)
    columns = np.broadcast_to(np.arange(0, 60, 4), (6, 15))
    return gather(*device(scan, measured), frame=frames, column=columns, scene=frames)
