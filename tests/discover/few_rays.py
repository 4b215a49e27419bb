"""Fits of fewer rays, which take as much less time, for tests whose findings are far beyond what decides them."""

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from jaxsim.discover.find import division
from jaxsim.discover.model.cast import blocks


@contextmanager
def looking_at(share: float) -> Iterator[None]:
    """Divisions look at this share of the rays that they usually do."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(division, "blocks", lambda *of, rays: blocks(*of, rays=int(share * rays)))
        yield
