"""The chart of the last checkpoints."""

from dataclasses import replace

import numpy as np

from jaxsim.studies.real2sim2real.epochs_chart import epochs_chart
from tests.studies.real2sim2real.made import COUNTS


def test_each_kind_has_a_line_over_the_checkpoints_and_a_thin_one_a_seed(scored):
    drawn = epochs_chart(scored)
    lines = [s for s in drawn.strokes if hasattr(s, "points") and len(s.points) == 3]
    assert [s.width for s in lines].count(2) == len(COUNTS)
    assert [s.width for s in lines].count(0.5) == 2 * len(COUNTS)
    thick = {s.colour: np.mean(s.points, axis=0)[1] for s in lines if s.width == 2}
    assert len(thick) == len(COUNTS)
    assert (drawn.pixels() < 128).any()
    assert epochs_chart(replace(scored, config=replace(scored.config, seeds=(7,)))) is None
