"""An effect of one's own among the candidates: it is named where it is hidden, and told what it looks like."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim.discover.model.evidence import gather
from jaxsim.discover.model.null_model import fit_null
from jaxsim.discover.name.look_alikes import described, look_alikes, with_look_alikes
from jaxsim.discover.name.select import choose
from jaxsim.discover.show.explain import named, own_candidates
from jaxsim.effects import EFFECTS, Effect, Parameter, all_rays, get_effect
from jaxsim.effects.edits import brighten
from jaxsim.effects.origin import Origin
from jaxsim.effects.own import own_effect, register_effect
from jaxsim.effects.street import small_street
from tests.discover.toy import device, toy
from tests.effects.own import forgetful  # noqa: F401  (a fixture)
from tests.report import results

pytestmark = [pytest.mark.long, pytest.mark.usefixtures("forgetful", "standard_promotion")]
AMOUNT = 0.25
ORIGIN = Origin(file="lobes.py", sha256="12ab")


def lobes(p, rays):
    return brighten(rays, p["amount"] * jnp.cos(3 * rays.azimuth_rad))


def lobes_effect():
    return own_effect(
        Effect(
            name="lobes",
            stage="receiver",
            title="three lobes around the turn",
            formula="ln I += amount · cos(3 az)",
            parameters={"amount": Parameter(0.0, -1.0, 1.0, "nats", "height of a lobe", scale=0.2)},
            channels=("intensity",),
            covariates=("azimuth",),
            apply=lobes,
        ),
        ORIGIN,
        "lobes.py",
    )


@pytest.fixture(scope="module")
def street():
    scan = small_street()
    return all_rays(scan), scan


@pytest.mark.slow
def test_an_own_effect_that_is_hidden_in_a_toy_case_is_named(tmp_path):
    register_effect(lobes_effect())
    frames = np.arange(9)  # as many as of `judged_toy`, whose programs are compiled for many files
    scan, measured = toy(len(frames))
    lit = measured.intensity * np.exp(AMOUNT * np.cos(3 * scan.grid.azimuth_rad)).astype(np.float32)
    measured = replace(measured, intensity=np.clip(lit, 0, 1))
    columns = np.broadcast_to(np.arange(0, 60, 2), (len(frames), 30))
    with jax.numpy_rank_promotion("allow"):
        ev = gather(*device(scan, measured), frame=frames, column=columns, scene=frames)
        null = fit_null(jax.tree.map(jnp.asarray, scan), ev)
        catalogue = [get_effect(name) for name in ("lobes", "beam_gain", "window_contamination")]
        catalogue = with_look_alikes(catalogue, null.ev.rays, null.scan)
        choice = choose(null, catalogue)
    assert [step.chosen.effect.name for step in choice.steps] == ["lobes"]
    assert choice.steps[0].fit.z["amount"] * 0.2 == pytest.approx(AMOUNT, abs=0.05)
    [one] = own_candidates(choice)
    assert (one.name, one.origin, one.why_not) == ("lobes", {"file": "lobes.py", "sha256": "12ab"}, "")
    assert named(choice.steps[0], {}).name == "lobes"

    # The report's part, with look-alikes made by hand.
    verdict = replace(results.named().verdict, own=(one,))
    assert verdict.to_json()["own"][0]["origin"]["sha256"] == "12ab"
    page = results.page(tmp_path, replace(results.named(), verdict=verdict))
    assert "Effects of your own" in page
    assert "lobes.py, SHA-256 12ab" in page
    assert "ln I += amount · cos(3 az)" in page


def test_a_page_without_own_effects_does_not_speak_of_them(tmp_path):
    assert "Effects of your own" not in results.page(tmp_path, results.named())
    assert results.named().verdict.to_json()["own"] == []


def test_what_the_catalogue_has_under_another_name_looks_like_it(street):
    law = replace(EFFECTS["range_falloff"], name="fall", look_alikes={}, covariates=("range",))
    own = own_effect(law, ORIGIN, "fall.py")
    seen = described(own, *street)
    assert seen == own  # to compiled programs
    assert seen.alike[0].name == "range_falloff"
    assert seen.alike[0].share > 0.999
    assert set(seen.look_alikes) >= {"range_falloff", "atmospheric_extinction"}
    assert "random_dropout" not in seen.look_alikes
    assert seen.look_alikes["range_falloff"].startswith("no frames like these")
    assert seen.look_alikes["atmospheric_extinction"].startswith("frames that span more ")


def test_what_no_effect_can_imitate_has_no_look_alike(street):
    assert look_alikes(lobes_effect(), *street) == ()
