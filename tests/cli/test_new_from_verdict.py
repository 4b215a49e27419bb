"""From an answer to an effect: what `discover` learned becomes a file that it takes as a candidate."""

import json
from dataclasses import replace

import jax
import numpy as np
import pytest

from jaxsim.cli import main
from jaxsim.discover.find.covariates import CURVES, Dependence, with_basis
from jaxsim.discover.law.learn import curve_form, learn
from jaxsim.discover.law.search import closed_law
from jaxsim.discover.model.evidence import gather
from jaxsim.discover.model.fit import fit
from jaxsim.discover.model.null_model import fit_null
from jaxsim.discover.name.candidates import rank_effects
from jaxsim.discover.verdict import Verdict
from jaxsim.effects.own import known_effects
from tests.discover.toy import device, toy
from tests.effects.own import forgetful  # noqa: F401  (a fixture)

pytestmark = [pytest.mark.long, pytest.mark.usefixtures("forgetful", "quick_programs")]
SLOPE = 0.05
"""Nats for each m/s, hidden in the toy."""


@pytest.fixture(scope="module")
def null():
    """The null of toy frames whose measured intensities grow with the speed, which grows from frame to frame."""
    scan, measured = toy(frames=9)
    speed = 2.0 * np.arange(9, dtype=np.float32)[:, None, None]
    measured = replace(measured, intensity=measured.intensity * np.exp(SLOPE * (speed - 8)))
    ev = gather(
        *device(scan, measured),
        frame=np.arange(9),
        column=np.broadcast_to(np.arange(0, 60, 2), (9, 30)),
        scene=np.arange(9),
    )
    with jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"):
        return fit_null(device(scan)[0], ev)


@pytest.fixture(scope="module")
def answer(null, tmp_path_factory):
    """The verdict.json of what was learned of them."""
    along = Dependence("intensity", "speed", 0.001, 0.1, 100.0)
    with jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"):
        [curve] = rank_effects(with_basis(null, "speed"), [CURVES["intensity"]], null_fits=null.null_fits)
        form = curve_form(null, along, curve)
        start = ({"height": form.start},)
        learned = learn(form, null, fit(form.law, null, np.ones(9, np.float32), starts=start))
    law = closed_law(learned)
    assert law, "no formula is near the learned curve"
    folder = tmp_path_factory.mktemp("out")
    return Verdict("not_in_catalogue", (), (), None, {}, None, ("a",), ("b",), "", 9, 1.0, law=law).save(folder)


def test_what_was_learned_becomes_a_candidate_that_wins(answer, null, tmp_path, capsys):
    path = tmp_path / "files" / "glow.py"
    path.parent.mkdir()
    main(["effects", "new", "faster_is_brighter", "--from", str(answer), "--out", str(path)])
    main(["effects", "check", str(path)])
    assert "all checks passed" in capsys.readouterr().out
    own = known_effects([path])["faster_is_brighter"]
    assert own.channels == ("intensity",)
    assert own.covariates == ("speed",)
    with jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"):
        [candidate] = rank_effects(null, [own])
    assert candidate.accepted()
    assert candidate.total > 10


def test_the_formula_rises_as_what_was_hidden(answer):
    law = json.loads(answer.read_text())["law"]
    numbers = {name: one["value"] for name, one in law["parameters"].items()}
    slow, fast = (
        eval(law["expression"], {**numbers, "exp": np.exp, "log": np.log, "speed_mps": speed})
        for speed in law["limits"]["speed_mps"]
    )
    assert fast - slow == pytest.approx(16 * SLOPE, rel=0.15)


def test_an_answer_without_a_formula_is_told_so(tmp_path):
    (tmp_path / "verdict.json").write_text('{"law": null}')
    with pytest.raises(SystemExit, match="holds no formula"):
        main(["effects", "new", "glow", "--from", str(tmp_path / "verdict.json"), "--out", str(tmp_path / "glow.py")])
    assert not (tmp_path / "glow.py").exists()
