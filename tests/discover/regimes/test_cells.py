"""What scenes ask for of an effect, and how the likelihood falls off along its way."""

import numpy as np
import pytest

from jaxsim.discover.model.fit import fit
from jaxsim.discover.regimes.cells import Shares, cells_of
from jaxsim.effects import EFFECTS
from tests.discover.regimes.halves import INSIDE, halves

pytestmark = [pytest.mark.long, pytest.mark.usefixtures("standard_promotion")]
GAIN = EFFECTS["beam_gain"]


@pytest.fixture(scope="module")
def weak(standard_promotion):
    """Gains well below the noise: along larger ones the likelihood, whose tails are heavy, is no parabola."""
    null, facts = halves(share=0.4)
    return null, facts, fit(GAIN, null)


def test_scenes_that_have_the_effect_ask_for_twice_what_fits_all(weak):
    null, facts, result = weak
    of = cells_of(GAIN, null, result, sector=facts.sector, sectors=facts.sectors)
    size = 1 + of.slope.sum(1) / of.curvature.sum(1)
    assert np.median(size[INSIDE]) == pytest.approx(2, abs=0.5)
    assert np.median(size[~INSIDE]) == pytest.approx(0, abs=0.4)


def test_half_of_the_way_the_slope_is_between_those_of_its_ends(weak):
    null, _, result = weak
    shares = Shares.of(GAIN, null, result)
    none, half, whole = (shares.slope(share).sum() for share in (0.0, 0.5, 1.0))
    assert none > half > whole
    assert half == pytest.approx((none + whole) / 2, abs=0.15 * (none - whole))
