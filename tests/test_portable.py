"""A network in a file of another format gives what the run gives: by onnxruntime, and by JAX alone."""

import json
import sys
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxsim
from configs.kitti_drives import experiment as drives
from configs.synthetic import experiment
from jaxsim.cli import main
from jaxsim.config import GeneratorConfig, PrepareConfig
from jaxsim.portable import PLATFORMS, export_network, onnx_model
from tests.untrained import untrained_run

PREPARE = PrepareConfig(inputs=("depth", "incidence", "row"), network_size=(16, 24), depth="given")
SMALL = GeneratorConfig(filters=4, blocks=1, downsamples=2, enhancers=1, enhancer_blocks=1)
FORMS = {
    "imaginaire": replace(experiment, prepare=PREPARE, generator=SMALL),
    "original": replace(experiment, prepare=PREPARE, generator=replace(SMALL, form="original")),
    "unet": replace(drives, prepare=PREPARE, generator=replace(drives.generator, filters=4)),
}


@pytest.fixture(scope="module", params=FORMS)
def folder(request, tmp_path_factory):
    return untrained_run(tmp_path_factory.mktemp("portable") / request.param, FORMS[request.param])


def test_onnx_gives_what_the_run_gives(folder, tmp_path, capsys):
    runtime = pytest.importorskip("onnxruntime")
    main(["convert", "generator", str(folder), "--to", "onnx", "--out", str(tmp_path / "g.onnx"), "--batch", "2"])
    assert "largest difference to the run's own answer" in capsys.readouterr().out
    session = runtime.InferenceSession(str(tmp_path / "g.onnx"))
    inputs = np.random.default_rng(1).uniform(-1, 1, (2, 16, 24, 15)).astype(np.float32)
    sensor = jaxsim.load(folder)
    expected = np.asarray(sensor.generate(sensor.params, inputs))
    (found,) = session.run(["outputs"], {"inputs": inputs})
    assert expected.std() > 0
    np.testing.assert_allclose(found, expected, atol=2e-5 * max(1, np.abs(expected).max()))
    told = json.loads((tmp_path / "g.onnx.json").read_text())
    assert len(told["inputs"]) == 15
    assert told["inputs"][:2] == ["depth", "incidence"]
    assert json.loads(session.get_modelmeta().custom_metadata_map["inputs"]) == told["inputs"]


@pytest.mark.long
def test_stablehlo_is_for_every_device_and_any_batch(folder, tmp_path):
    pytest.importorskip("flatbuffers")
    sensor = jaxsim.load(folder)
    made = export_network(sensor, tmp_path / "g.stablehlo", to="stablehlo")
    assert made.difference < 1e-4
    read = jax.export.deserialize(bytearray((tmp_path / "g.stablehlo").read_bytes()))
    assert read.platforms == PLATFORMS
    inputs = np.random.default_rng(1).uniform(-1, 1, (3, 16, 24, 15)).astype(np.float32)
    expected = np.asarray(sensor.generate(sensor.params, inputs))
    np.testing.assert_allclose(read.call(inputs), expected, atol=2e-5 * max(1, np.abs(expected).max()))


@pytest.mark.parametrize(
    "function",
    [
        lambda x: jnp.where(x > 0, x**3, jnp.exp(x)) / (1 + x * x),
        lambda x: x[:, ::-1, 1:8:3] + jnp.take(x, np.array([2, 0, 3]), axis=2),
        lambda x: jnp.pad(x, ((0, 0), (1, 2), (0, 0))).max(1) - jax.nn.sigmoid(x).sum(1),
        lambda x: jnp.einsum("bij,bik->bkj", x, x),
        lambda x: jnp.stack([x, jnp.abs(x)], axis=1).transpose(2, 0, 1, 3).reshape(-1, 9),
        lambda x: jnp.concatenate([x[:, :0], x], axis=1).astype(jnp.int32).astype(jnp.float32),
    ],
)
def test_each_primitive_means_the_same(function):
    runtime = pytest.importorskip("onnxruntime")
    x = np.random.default_rng(0).normal(size=(2, 5, 9)).astype(np.float32)
    model = onnx_model(function, x.shape, name="f", metadata={})
    (found,) = runtime.InferenceSession(model.SerializeToString()).run(None, {"inputs": x})
    np.testing.assert_allclose(found, function(x), atol=1e-5)


def test_what_has_no_translation_is_named():
    pytest.importorskip("onnx")
    with pytest.raises(NotImplementedError, match="sort of the network has no translation"):
        onnx_model(lambda x: jnp.sort(x), (4,), name="f", metadata={})


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["generator", "embedded"], "--to stablehlo or --to onnx"),
        (["vgg19", "weights.npz", "--to", "onnx"], "--to onnx is for generator"),
        (["generator", "embedded", "--to", "onnx", "--batch", "0"], "a batch of 0; give 1 or more"),
        (["generator", "nowhere", "--to", "onnx"], "nowhere"),
        (["generator", "embedded", "--to", "stablehlo"], "writes NAME.stablehlo, and --out is out.onnx"),
    ],
)
def test_wrong_requests_write_nothing(arguments, said, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as ended:
        main(["convert", *arguments, "--out", "out.onnx"])
    assert said in str(ended.value)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("to", "package"), [("onnx", "onnx"), ("stablehlo", "flatbuffers")])
def test_a_missing_extra_is_named(to, package, monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(ModuleNotFoundError, match=rf"needs {package}; pip install 'jaxsim-lidar\[portable\]'"):
        export_network(jaxsim.load("embedded"), tmp_path / f"out.{to}", to=to)
    assert not list(tmp_path.iterdir())
