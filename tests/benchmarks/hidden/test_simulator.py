"""Simulators with errors of their own: the ideal one changes nothing, the others what they say."""

import json

import numpy as np
import pytest

from benchmarks.blind.hidden import key_path, make_case
from benchmarks.blind.hidden.simulator import SIMULATORS

SMALL = {"scenes": 2, "rows": 16, "columns": 96}
BEFORE = {
    ("measured", "range"): 60138.83321261406,
    ("measured", "intensity"): 687.0804869621061,
    ("simulated", "range"): 60790.767875909805,
    ("simulated", "intensity"): 618.8542332757497,
}


def _frames(folder, part):
    arrays = [np.load(file) for file in sorted((folder / part).glob("*.npz"))]
    return {name: np.stack([a[name] for a in arrays]) for name in arrays[0]}


@pytest.fixture(scope="module")
def cases(tmp_path_factory):
    """A null of each simulator: {name: (simulated, measured, key)}."""
    out = {}
    for name in SIMULATORS:
        folder = tmp_path_factory.mktemp("cases") / name
        make_case(folder, effect="none", seed=3, nuisance="exact", simulator=name, **SMALL)
        out[name] = (
            *(_frames(folder, part) for part in ("simulated", "measured")),
            json.loads(key_path(folder).read_text()),
        )
    return out


def test_cases_from_before_there_were_other_simulators_stay_what_they_were(tmp_path):
    make_case(tmp_path / "a", effect="none", seed=12345, nuisance="misspecified", scenes=3, rows=16, columns=96)
    sums = {
        (part, name): float(_frames(tmp_path / "a", part)[name].sum(dtype=np.float64))
        for part in ("measured", "simulated")
        for name in ("range", "intensity")
    }
    assert sums == pytest.approx(BEFORE, rel=1e-6)


def test_the_ideal_simulator_has_no_noise_and_no_texture(cases):
    simulated = cases["ideal"][0]
    hit = simulated["range"] > 0
    level = simulated["intensity"][hit] / np.cos(simulated["incidence"][hit])
    kinds = simulated["semantic"][hit]
    assert max(np.ptp(level[kinds == kind]) for kind in np.unique(kinds)) < 1e-5


def test_noisy_sides_have_their_own_draws_of_the_same_noise(cases):
    simulated, measured, key = cases["noisy"]
    for side in (simulated, measured):
        counts = side["intensity"] * 255
        np.testing.assert_allclose(counts, counts.round(), atol=1e-3)
    lost = (simulated["range"] == 0) & (measured["range"] > 0)
    assert 0.003 < lost.mean() < 0.03
    assert (simulated["semantic"][lost] == 0).all()
    both = (simulated["range"] > 0) & (measured["range"] > 0)
    apart = (measured["range"] - simulated["range"])[both]
    assert 1.4826 * np.median(np.abs(apart)) == pytest.approx(0.015 * np.sqrt(2), rel=0.15)
    assert key["simulator"]["name"] == "noisy"
    assert key["simulator"]["loss"] == key["nuisance"]["drop"] == 0.01
    assert key["simulator"]["relative_sd"] == key["nuisance"]["intensity_sd"] == 0.06


def test_rounded_sides_lie_on_one_lattice(cases):
    simulated, measured, key = cases["rounded"]
    step = key["simulator"]["range_step_m"]
    assert step in (0.001, 0.01)
    for side in (simulated, measured):
        np.testing.assert_allclose(side["intensity"] * 255, (side["intensity"] * 255).round(), atol=1e-3)
        np.testing.assert_allclose(side["range"] / step, (side["range"] / step).round(), atol=0.02)


def test_a_hidden_lattice_takes_the_place_of_the_shared_one(tmp_path):
    make_case(tmp_path / "a", effect="range_quantization", severity=2, seed=3, simulator="rounded", **SMALL)
    step = json.loads(key_path(tmp_path / "a").read_text())["effects"][0]["parameters"]["step_m"]
    read = _frames(tmp_path / "a", "measured")["range"]
    np.testing.assert_allclose(read / step, (read / step).round(), atol=0.02)


def test_a_network_shows_half_of_the_texture(cases):
    simulated, measured, key = cases["network"]
    both = (simulated["range"] > 0) & (measured["range"] > 0) & (measured["intensity"] > 0)
    light = np.log(np.where(both, simulated["intensity"] / np.cos(simulated["incidence"]), 1))
    detail = np.diff(light, n=2, axis=2)
    same = both[..., :-2] & both[..., 1:-1] & both[..., 2:] & (np.ptp(_triples(simulated["semantic"]), axis=0) == 0)
    # Where all three rays lie in cells of texture of their own, their second difference has 6 times the variance.
    spread = 1.4826 * np.median(np.abs(detail[same])) / np.sqrt(6)
    assert 0.5 < spread / (0.5 * key["nuisance"]["texture_sd"]) < 1.3


def _triples(x):
    return np.stack([x[..., :-2], x[..., 1:-1], x[..., 2:]])


def test_an_unknown_simulator_is_refused(tmp_path):
    with pytest.raises(ValueError, match="choose one of ideal, noisy"):
        make_case(tmp_path / "a", effect="none", seed=1, simulator="perfect", **SMALL)
    assert not (tmp_path / "a").exists()
