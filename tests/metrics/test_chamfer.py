"""Chamfer distances of clouds."""

import numpy as np
import pytest
from scipy.spatial.distance import cdist

from jaxsim.metrics.bev import jensen_shannon, lidm_occupancy
from jaxsim.metrics.chamfer import LIDAR_ALPHA_PER_M2, chamfer
from tests.metrics.made_generation import clouds


def test_lidar_diffusion_s_scores_equal_the_published_values(published):
    arrays, values = published
    reference, generated = (list(arrays[f"clouds_{side}"]) for side in ("ref", "gen"))
    occupancy = [lidm_occupancy(side) for side in (reference, generated)]
    assert [float(o.sum()) for o in occupancy] == values["lidm_bev_sum"]
    assert jensen_shannon(*occupancy) == pytest.approx(values["lidm_jsd"], rel=1e-5)
    pairs = zip(reference[:3], generated[:3], strict=True)
    assert np.mean([chamfer(a, b).square_m2 for a, b in pairs]) == pytest.approx(values["lidm_cd_3d_first3"], rel=1e-5)


def test_chamfer_equals_the_table_of_all_distances():
    a, b = clouds(5, 1, 300)[0], clouds(6, 1, 220)[0]
    table = cdist(a.astype(float), b.astype(float))
    got = chamfer(a, b)
    assert got.distance_m == pytest.approx((table.min(1).mean() + table.min(0).mean()) / 2)
    assert got.square_m2 == pytest.approx(((table**2).min(1).mean() + (table**2).min(0).mean()) / 2)
    # Density-aware, point by point.
    parts = []
    for t in (table, table.T):
        nearest = t.argmin(1)
        terms = [
            1 - np.exp(-LIDAR_ALPHA_PER_M2 * t[i, j] ** 2) * (t.shape[0] / t.shape[1]) / np.sum(nearest == j)
            for i, j in enumerate(nearest)
        ]
        parts.append(np.mean(terms))
    assert got.density_aware == pytest.approx(np.mean(parts))


def test_density_aware_chamfer_sees_clumps_that_chamfer_does_not():
    line = np.stack([np.linspace(0, 40, 200), np.zeros(200), np.zeros(200)], 1)
    clumped = line.copy()
    clumped[:100] = line[0]  # half of the points in one place
    assert chamfer(line, line).density_aware == pytest.approx(0)
    assert chamfer(clumped, line).density_aware > 0.4
    with pytest.raises(ValueError, match="empty"):
        chamfer(line, line[:0])
