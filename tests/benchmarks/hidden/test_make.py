"""Cases: nothing leaks, same seed same case, effects touch their own channels alone, severity scales."""

import ast
import inspect
import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.blind.hidden import list_combinations, list_effects, list_outside, make_case
from benchmarks.blind.hidden.case import key_path, look_at, make_setting, measure, plant, predict
from benchmarks.blind.hidden.catalogue import COVARIATES, EFFECTS, FAMILIES, Choice, amount_of, choose, unit_of
from benchmarks.blind.hidden.frames import read_out
from benchmarks.blind.hidden.nuisance import stream

SMALL = {"scenes": 3, "rows": 16, "columns": 96}


@pytest.fixture(scope="module")
def street():
    """A setting with its prediction, its surfaces and its reading with nothing planted."""
    setting = make_setting((5, 6), "default", 3, 1, 24, 128)
    simulated = predict(setting)
    return setting, simulated, look_at(setting, simulated), _read(setting, simulated, [])


def _read(setting, simulated, plans):
    readings = [read_out(s, setting.nuisance) for s in measure(setting, simulated, plans)]
    return {k: np.stack([r[k] for r in readings]) for k in ("range", "intensity")}


def _planted(street, choice, severity):
    setting, simulated, about, _ = street
    plans, _ = plant(choice, severity, setting, about)
    return _read(setting, simulated, plans)


def _content(folder: Path) -> list:
    """File names, sizes, arrays, dtypes, shapes and metadata keys of a case folder."""
    out = []
    for file in sorted(folder.rglob("*")):
        name = str(file.relative_to(folder))
        if file.suffix == ".npz":
            with np.load(file) as arrays:
                out.append((name, file.stat().st_size, [(k, arrays[k].dtype.str, arrays[k].shape) for k in arrays]))
        elif file.suffix == ".json":
            grid = json.loads(file.read_text())
            frames = [(k, sorted(v), v["scene"]) for k, v in grid["frames"].items()]
            out.append((name, sorted(grid), frames, len(grid["azimuth"]), len(grid["elevation"]), set(grid["origin"])))
        else:
            out.append((name,))
    return out


@pytest.mark.parametrize("effect", ["beam_gain", "fog_backscatter", "range_quantization", "outside:speed_drop"])
def test_a_case_folder_looks_the_same_whatever_it_hides(tmp_path, effect):
    make_case(tmp_path / "null", effect="none", seed=1, **SMALL)
    make_case(tmp_path / "planted", effect=effect, seed=2, **SMALL)
    assert _content(tmp_path / "null") == _content(tmp_path / "planted")
    for name in ("null", "planted"):
        assert {p.name for p in (tmp_path / name).iterdir()} == {"measured", "simulated"}
        assert set(json.loads((tmp_path / name / "measured" / "grid.json").read_text())) == {
            "azimuth",
            "elevation",
            "origin",
            "frames",
        }


def test_the_key_lies_outside_the_case_folder(tmp_path):
    make_case(tmp_path / "c", effect="none", seed=1, **SMALL)
    assert key_path(tmp_path / "c").exists()
    assert key_path(tmp_path / "c").parent == tmp_path


def test_null_and_planted_case_of_one_seed_share_no_street(tmp_path):
    make_case(tmp_path / "a", effect="none", seed=1, **SMALL)
    make_case(tmp_path / "b", effect="beam_gain", seed=1, **SMALL)
    a, b = (np.load(tmp_path / n / "simulated" / "0000.npz")["range"] for n in "ab")
    assert not np.allclose(a, b, atol=0.5)


def test_the_same_seed_gives_the_same_case(tmp_path):
    keys = [make_case(tmp_path / n, effect="random", seed=9, **SMALL) for n in "ab"]
    assert keys[0].effects == keys[1].effects
    assert keys[0].case == keys[1].case
    for part in ("measured", "simulated"):
        for file in (tmp_path / "a" / part).iterdir():
            assert file.read_bytes() == (tmp_path / "b" / part / file.name).read_bytes()


def test_a_case_is_never_overwritten(tmp_path):
    make_case(tmp_path / "a", effect="none", seed=1, **SMALL)
    with pytest.raises(FileExistsError, match="never overwritten"):
        make_case(tmp_path / "a", effect="none", seed=1, **SMALL)


def test_unknown_names_and_sizes_are_refused(tmp_path):
    with pytest.raises(ValueError, match="choose none, random"):
        make_case(tmp_path / "a", effect="beam_gian", seed=1)
    with pytest.raises(ValueError, match="outside:warp is not known"):
        make_case(tmp_path / "a", effect="outside:warp", seed=1)
    with pytest.raises(ValueError, match="misspecified"):
        make_case(tmp_path / "a", effect="none", nuisance="wild", seed=1)
    with pytest.raises(ValueError, match="severity is -1"):
        make_case(tmp_path / "a", effect="none", severity=-1, seed=1)
    with pytest.raises(ValueError, match="given twice"):
        choose("beam_gain+beam_gain", np.random.default_rng(0))
    assert not (tmp_path / "a").exists()


@pytest.mark.parametrize("name", [*list_effects(), *(f"outside:{n}" for n in list_outside())])
def test_an_effect_changes_its_own_channels_and_no_other(street, name):
    null = street[3]
    planted = _planted(street, choose(name, np.random.default_rng(0)), 4.0)
    ray = EFFECTS[name].channels if name in EFFECTS else None
    seen = (null["range"] > 0) & (planted["range"] > 0)
    changed = {
        "range": bool((null["range"] != planted["range"])[seen].any()),
        "intensity": bool((null["intensity"] != planted["intensity"])[seen].any()),
        "drop": bool(((null["range"] > 0) != (planted["range"] > 0)).any()),
    }
    if ray is not None:
        assert {c for c, yes in changed.items() if yes} <= set(ray)
    assert any(changed.values())


@pytest.mark.parametrize("name", ["range_falloff", "beam_gain", "random_dropout", "range_scale", "fog_backscatter"])
def test_severity_scales(street, name):
    null = street[3]

    def size(severity):
        planted = _planted(street, Choice((name,)), severity)
        lost = (null["range"] > 0) & (planted["range"] == 0)
        return (
            np.abs(planted["range"] - null["range"]).mean()
            + np.abs(planted["intensity"] - null["intensity"]).mean()
            + lost.mean()
        )

    assert size(1.0) < size(2.0) < size(4.0)


def test_every_effect_says_where_it_shows():
    assert set(COVARIATES) == set(EFFECTS)
    # The same error, or loss, for all rays shows along nothing.
    assert {n for n in EFFECTS if not COVARIATES[n]} == {"random_dropout", "range_offset"}
    assert {c for family in FAMILIES.values() for c in family} == set(EFFECTS)


def test_units_are_positive_and_capped():
    for name in list_effects():
        assert 0 < unit_of(name) < np.inf
        assert amount_of(name, 1e9) == EFFECTS[name].cap or EFFECTS[name].cap == np.inf


def test_keys_state_the_parameters_in_the_catalogues_terms(street):
    setting, _, about, _ = street
    stated = {}
    for name in list_effects():
        _, (entries, _) = plant(Choice((name,)), 2.0, setting, about)
        stated[name] = entries[0]["parameters"]
        assert json.loads(json.dumps(stated[name])) == stated[name]
    assert len(stated["beam_gain"]["gain"]) == len(setting.grid.elevation)
    assert len(stated["material_dropout"]["probability"]) == 34
    assert stated["atmospheric_extinction"]["coefficient_per_m"] == pytest.approx(
        amount_of("atmospheric_extinction", 2.0), rel=0.1
    )
    assert abs(stated["range_falloff"]["exponent"]) == pytest.approx(amount_of("range_falloff", 2.0), rel=0.1)


def test_exact_nulls_have_exact_geometry_and_labels():
    setting = make_setting((1, 2), "exact", 2, 1, 16, 96)
    simulated = predict(setting)
    state = measure(setting, simulated, [])[0]
    smooth = state.hit & (np.abs(state.range_m - simulated[0]["range"]) < 0.5)
    assert smooth.mean() > 0.9
    assert np.median(np.abs(state.range_m[smooth] - simulated[0]["range"][smooth])) < 1e-9
    np.testing.assert_allclose(state.theta[state.hit], simulated[0]["incidence"][state.hit], atol=1e-6)
    assert (state.semantic == simulated[0]["semantic"]).all()


def test_far_ranges_and_many_materials_are_there():
    setting = make_setting((3, 3), "default", 8, 1, 32, 192)
    simulated = predict(setting)
    r = np.stack([s["range"] for s in simulated])
    assert (r > 60).sum() > 0.02 * (r > 0).sum()
    assert (r > 80).any()
    assert r[r > 0].min() > 1.0
    kinds = np.bincount(np.stack([s["semantic"] for s in simulated])[r > 0], minlength=34)
    assert (kinds > 100).sum() >= 6
    headings = np.array([m.heading_rad for m in setting.moments])
    assert np.ptp(headings) > np.pi
    assert np.ptp([m.speed_m_s for m in setting.moments]) > 5
    assert setting.moments[-1].time_s > 240


def test_a_null_returns_nearly_everything_that_is_hit(street):
    _, simulated, _, null = street
    hit = np.stack([s["range"] for s in simulated]) > 0
    assert 0.97 < (null["range"][hit] > 0).mean() < 0.9999
    assert (null["intensity"][null["range"] == 0] == 0).all()
    assert null["intensity"].max() <= 1


def test_combinations_differ_physically_and_are_balanced():
    pairs = list_combinations(2, 40, seed=1)
    assert len(set(pairs)) == 40
    assert len({n for p in pairs for n in p}) > 30
    assert all(not {"range_falloff", "atmospheric_extinction"} <= set(p) for p in pairs)
    assert len(list_combinations(3, 20, seed=1)[0]) == 3
    with pytest.raises(ValueError, match="too many"):
        list_combinations(1, 500, seed=1)


def test_random_streams_depend_on_their_purpose_alone():
    assert stream((1,), "a", 2).random() == stream((1,), "a", 2).random()
    assert stream((1,), "a", 2).random() != stream((1,), "a", 3).random()
    assert stream((1,), "a").random() != stream((2,), "a").random()


def test_no_module_here_imports_the_package_under_test():
    files = [*Path(inspect.getfile(make_case)).parent.glob("*.py")]
    assert len(files) > 10
    for file in files:
        for node in ast.walk(ast.parse(file.read_text())):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom):
                names = [node.module or ""]
            for name in names:
                assert name.split(".")[0] not in {"jaxsim", "jax", "flax", "optax", "configs"}, (file.name, name)
            dynamic = isinstance(node, ast.Call) and getattr(node.func, "id", getattr(node.func, "attr", ""))
            assert dynamic not in {"__import__", "import_module"}, file.name
