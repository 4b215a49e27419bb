"""The file of an effect of one's own that a formula makes."""

import json
import runpy
from dataclasses import replace
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim.discover.law.learn import LearnedFit
from jaxsim.discover.law.search import VARIABLES, Variable, closed_law, formula_shapes
from jaxsim.discover.law.source import check_expression, read_law, write_effect
from jaxsim.discover.verdict import Verdict
from jaxsim.effects import all_rays
from jaxsim.effects.learned import Learned
from jaxsim.effects.rays import READ
from tests.discover.law.made_laws import learned
from tests.effects.streets import clutter_of_everything

KNOTS = tuple(np.linspace(np.log(2), np.log(90), 20).tolist())
TRUTH = {
    "intensity": lambda x: 0.01 * x,
    "range": lambda x: 0.1 * np.sin(2 * np.pi * x / 25),
    "drop": lambda x: 0.3 * (x > 20),
}


@cache
def law_of(channel):
    curve, without = learned(TRUTH[channel](np.exp(KNOTS)), sd=0.005)
    values = tuple(np.clip(curve, 0, 0.95).tolist() if channel == "drop" else curve.tolist())
    law = Learned(channel, "curve", ("range",), (KNOTS,), values, (0.005,) * 20)
    found = closed_law(LearnedFit(law, without, 20))
    assert found
    return found


@pytest.mark.parametrize("channel", TRUTH)
def test_the_file_does_what_the_formula_says(channel, tmp_path):
    law = law_of(channel)
    effect = runpy.run_path(str(write_effect(law, tmp_path / "mine.py")))["EFFECT"]
    assert (effect.name, effect.channels, effect.covariates) == ("mine", (channel,), ("range",))
    rays = jax.jit(all_rays)(clutter_of_everything())
    numbers = {name: jnp.float32(one.value) for name, one in law.parameters.items()}
    after = effect.apply(numbers, rays)
    hit = np.asarray(rays.hit)
    x = np.asarray(rays.range_m)[hit]
    change = {
        "intensity": after.log_intensity - rays.log_intensity,
        "range": after.reading_m - rays.reading_m,
        "drop": 1 - jnp.exp(after.log_keep),
    }[channel]
    apart = np.abs(np.asarray(change)[hit] - TRUTH[channel](x))
    # The place of a step is known to a knot.
    assert np.quantile(apart, 0.8) < 0.02
    neutral = effect.apply(effect.values({}, 5), rays)
    np.testing.assert_allclose(np.asarray(neutral.log_intensity), np.asarray(rays.log_intensity))
    np.testing.assert_allclose(np.asarray(neutral.log_keep), np.asarray(rays.log_keep), atol=1e-6)
    for name, parameter in effect.parameters.items():
        assert parameter.low <= parameter.neutral <= parameter.high
        assert parameter.low <= law.parameters[name].value <= parameter.high


def test_a_law_goes_through_verdict_json(tmp_path):
    law = law_of("intensity")
    verdict = Verdict("not_in_catalogue", (), (), None, {}, None, ("a",), ("b",), "", 2, 1.0, law=law)
    replace(verdict, gap={}).save(tmp_path)
    again = read_law(tmp_path / "verdict.json")
    assert (again.expression, again.covariates, again.nodes) == (law.expression, law.covariates, law.nodes)
    assert again.parameters["size"].value == pytest.approx(law.parameters["size"].value, rel=1e-5)
    assert write_effect(again, tmp_path / "mine.py").is_file()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "no file"),
        ({"law": None}, "holds no formula"),
        ({}, "is no verdict.json"),
        ({"law": 3}, "holds a `law` that is none"),
    ],
)
def test_a_verdict_without_a_law_is_refused(tmp_path, content, message):
    if content is not None:
        (tmp_path / "verdict.json").write_text(json.dumps(content))
    with pytest.raises(ValueError, match=message):
        read_law(tmp_path / "verdict.json")


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"expression": "__import__('os').system('touch owned')"}, "it holds"),
        ({"expression": "level + size * range_m.real"}, "it holds 'range_m.real'"),
        ({"expression": "level + exit(range_m)"}, "it holds 'exit"),
        ({"expression": "exp(*range_m)"}, "it holds"),
        ({"expression": "[level for level in range_m]"}, "it holds"),
        ({"expression": "level + size * 9**9**9**9"}, "it holds '9 "),
        ({"expression": "level + 'a'"}, "it holds \"'a'\""),
        ({"expression": "level + size * incidence_rad"}, "it holds 'incidence_rad'"),
        ({"expression": "level)\nimport os  # ("}, "is no formula of range_m"),
        ({"expression": "(" * 300}, "is no formula of range_m"),
        ({"expression": "level" + " + level" * 100}, "is too long"),
        ({"formula": 'x""" + __import__("os").system("touch owned") + """'}, "holds what no formula does"),
        ({"formula": "x\n"}, "holds what no formula does"),
        ({"covariates": ["rain"]}, "covariate 'rain' is in no formula"),
        ({"channel": "colour"}, "channel 'colour' is not known"),
        ({"parameters": {"x[0]": {"value": 1.0, "low": 0.0, "high": 2.0, "unit": ""}}}, "parameter 'x.0.' is in no"),
        ({"limits": {}}, "limits of range_m are missing"),
        ({"limits": {"range_m": [90.0, 2.0]}}, "or do not rise"),
        ({"share": 1e30}, "a number is beyond"),
    ],
)
def test_a_strangers_formula_becomes_no_code(tmp_path, changed, message):
    law = law_of("intensity")
    Verdict("not_in_catalogue", (), (), None, {}, None, ("a",), ("b",), "", 2, 1.0, law=law).save(tmp_path)
    path = tmp_path / "verdict.json"
    content = json.loads(path.read_text())
    path.write_text(json.dumps(content | {"law": content["law"] | changed}))
    with pytest.raises(ValueError, match=rf"verdict\.json holds a `law` that is none: .*{message}"):
        read_law(path)


def test_every_formula_of_the_grammar_may_become_code():
    for variable, unit in VARIABLES.values():
        for x in (np.linspace(-2, 3, 20), np.geomspace(1e-3, 90, 20)):
            for shape in formula_shapes([Variable(variable, unit, x), Variable("row", "", x)]):
                own = [word for word in (variable, "row") if word in shape.expression]
                check_expression(shape.expression, [*own, "pi", "phase", "level", "size", shape.constant])


def test_names_that_cannot_be_are_refused(tmp_path):
    law = law_of("intensity")
    for name in ("beam_gain.py", "two words.py", "class.py", "check.py", "Mine.py", "mine.txt"):
        with pytest.raises(ValueError, match="is no name for an effect"):
            write_effect(law, tmp_path / name)
    write_effect(law, tmp_path / "mine.py")
    with pytest.raises(ValueError, match="is there already"):
        write_effect(law, tmp_path / "mine.py")


def test_every_variable_is_a_covariate_with_a_name_of_its_own():
    assert set(VARIABLES) <= set(READ)
    names = [name for name, _ in VARIABLES.values()]
    assert len(set(names)) == len(names)
    assert all(name.isidentifier() for name in names)


def test_the_file_imports_each_module_once(tmp_path):
    text = write_effect(law_of("range"), tmp_path / "mine.py").read_text()
    modules = [line.split()[1] for line in text.splitlines() if line.startswith("from ")]
    assert modules == sorted(set(modules))
