"""Every way in which an effect of one's own can be wrong is told before anything is fitted."""

import pytest

from jaxsim.effects.check import check_effect
from jaxsim.effects.own import known_effects
from tests.effects.own import forgetful, write  # noqa: F401  (a fixture)

pytestmark = pytest.mark.usefixtures("forgetful")


def parameter(neutral: object = 0.0, low: object = 0.0, high: object = 1.0, scale=0.3, more=""):
    return f'Parameter({neutral}, {low}, {high}, "", "a share", scale={scale}{more})'


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"name": '"beam_gain"'}, "beam_gain: the catalogue has an effect of this name"),
        ({"name": '"Rain"'}, "the name is 'Rain'; give lower-case words"),
        ({"name": '"check"'}, "the name is 'check'"),
        ({"stage": '"lens"'}, "the stage is 'lens'; it must be one of geometry, surface"),
        ({"stage": '"geometry"'}, "stage geometry with casts=0"),
        ({"title": '""'}, "its title is empty"),
        ({"title": ""}, "TypeError: .*'title'"),
        ({"channels": '("colour",)'}, r"channels are \('colour',\); give a tuple of intensity, range, drop"),
        ({"channels": "()"}, r"channels are \(\)"),
        ({"covariates": '("weather",)'}, "covariates are .* give a tuple of range, incidence"),
        ({"parameters": "{}"}, "parameters must be a dict of one Parameter or more"),
        ({"parameter": parameter(neutral=2.0)}, r"share is 2 at neutral, outside its bounds 0\.\.1"),
        ({"parameter": parameter(low=1.0, high=0.0)}, r"share has bounds 1\.\.0; the lower must come first"),
        ({"parameter": parameter(scale=0.0)}, "share has scale 0"),
        ({"parameter": parameter(high="float('inf')")}, "all must be finite"),
        ({"parameter": parameter(more=", to_fit=False")}, "no parameter is fitted"),
        ({"apply": 'apply, starts=({"share": 2.0},)'}, r"share is 2; it must lie in 0\.\.1"),
    ],
)
def test_its_row_must_be_right(tmp_path, changes, words):
    with pytest.raises(ValueError, match=words):
        known_effects([write(tmp_path, **changes)])


@pytest.mark.parametrize(
    ("of", "field", "value", "words"),
    [
        ("effect", "channels", "intensity", "channels are 'intensity'; give a tuple"),
        ("effect", "covariates", "row", "covariates are 'row'; give a tuple"),
        ("effect", "parameters", {"share": 0.0}, "a dict of one Parameter or more"),
        ("parameter", "shape", "beam", "share has shape 'beam'"),
    ],
)
def test_types_that_nothing_checks_outside_of_tests_are_told_too(tmp_path, of, field, value, words):
    effect = known_effects([write(tmp_path)])["vignetting"]
    object.__setattr__(effect if of == "effect" else effect.parameters["share"], field, value)
    with pytest.raises(ValueError, match=words):
        check_effect(effect)


@pytest.mark.parametrize(
    ("law", "words"),
    [
        ("brighten(rays, 0.1 + 0 * rays.range_m)", "changes log_intensity by up to 0.1 at neutral parameters"),
        ("brighten(rays, p['size'])", r"apply raised KeyError at neutral parameters: 'size'"),
        ("None", "apply gives NoneType at neutral parameters; it must give Rays"),
        ("rays.replace(log_intensity=p['share'])", r"makes log_intensity \(\) float32 at .* keep shape and dtype"),
        ("rays.replace(hit=rays.hit.astype('float32'))", "makes hit .* float32 at neutral"),
        ("brighten(rays, jnp.where(p['share'] > 0.9, jnp.nan, 0.0) + 0 * rays.range_m)", "NaN in .* share = 1"),
        ("brighten(rays, jnp.sqrt(p['share'] * (rays.range_m + 1)))", "derivative in share is not finite at neutral"),
        ("brighten(rays, float(p['share']) * rays.range_m)", "no derivative at neutral parameters: Concretization"),
        (
            "rays if p['share'] == 0 else brighten(rays, p['share'] * rays.range_m)",
            "no derivative at .* `if` on arrays or",
        ),
        ("rays.replace(reading_m=rays.reading_m + p['share'])", "changes the channel range, and channels are"),
        ("brighten(rays, 0 * p['share'] * rays.range_m)", "channels name intensity, which apply never changes"),
        ("rays.replace(range_m=rays.range_m + p['share'])", "changes range_m at share = 0.3, which is the ray itself"),
        ("rays.replace(turned_rad=rays.turned_rad + p['share'])", "changes turned_rad at .* with casts=0"),
        (
            "rays.replace(clutter=rays.clutter + p['share'])",
            "early false returns are a part of the likelihood that fog",
        ),
        ("rays.replace(intensity_step=rays.intensity_step + p['share'])", "steps are read off the readings"),
        ("brighten(rays, jnp.round(4 * p['share']) * rays.range_m)", "derivative in share is 0 at all that was tried"),
        (
            "brighten(rays, p['share'] * __import__('numpy').random.rand())",
            "gives another log_intensity the second time at share",
        ),
        ("rays.replace(log_keep=rays.log_keep + p['share'])", "makes log_keep more than 0"),
        ("rays.replace(ghost=rays.ghost + 2 * p['share'])", r"makes ghost 2\.\.2 at share = 1; it is a probability"),
    ],
)
def test_its_apply_must_be_right(tmp_path, law, words):
    with pytest.raises(ValueError, match=words):
        known_effects([write(tmp_path, law=law)])


@pytest.mark.long
def test_an_effect_that_turns_rays_passes_with_casts(tmp_path):
    law = "displace(rays, turn_rad=(p['share'] * jnp.ones_like(rays.range_m), jnp.zeros_like(rays.range_m)))"
    path = write(
        tmp_path,
        law=law,
        stage='"geometry", casts=2',
        channels='("intensity", "range", "drop")',
        parameter=parameter(low=-0.1, high=0.1, scale=0.03),
    )
    path.write_text(path.read_text().replace("import brighten", "import displace"))
    assert "vignetting" in known_effects([path])
