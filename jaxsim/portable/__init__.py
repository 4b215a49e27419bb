"""A run's network as a file for others: StableHLO, which JAX's own `jax.export` reads anywhere, and ONNX.

Both hold the weights and one function, inputs (b, h, w, channels) in float32 to outputs (b, h, w, k); beside either
lies a `.json` that says what the channels are. What makes these inputs from a camera's view is `jaxsim.prepare`.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import jax
import numpy as np
from jaxtyping import Float

from jaxsim.config import LEVELS
from jaxsim.files import need, replacing, write_text
from jaxsim.frame import Array
from jaxsim.pix2pix import make_generate
from jaxsim.pix2pix.convolution import for_any_device
from jaxsim.portable.onnx_graph import onnx_model
from jaxsim.prepare import CHANNELS, input_channels
from jaxsim.simulate import LearnedSensor

Form = Literal["stablehlo", "onnx"]
PLATFORMS = ("cpu", "cuda", "tpu")
Network = Callable[[Array], Array]


@dataclass(frozen=True)
class Exported:
    """What was written."""

    path: Path
    size: int
    """Bytes."""
    difference: float | None
    """The largest between what the file's network and the run's give of one input; None where nothing here can run
    the file."""


def export_network(sensor: LearnedSensor, path: Path, *, to: Form, batch: int | None = None) -> Exported:
    """Writes the run's network, and beside it what its channels are.

    StableHLO takes any batch unless one is given, and lowers for CPU, CUDA and TPU; ONNX takes the batch given, by
    default 1. Raises ModuleNotFoundError without what writes the file, ValueError for a batch below 1.
    """
    if batch is not None and batch < 1:
        raise ValueError(f"convert: a batch of {batch}; give 1 or more")
    experiment = sensor.run.experiment
    channels = input_channels(experiment.prepare)
    size = (*experiment.prepare.network_size, channels)
    told = describe(sensor)
    # Another function than the sensor's own, which may have been traced for this machine's device already.
    generate = make_generate(experiment, channels)
    network: Network = lambda inputs: generate(sensor.params, inputs)  # noqa: E731
    inputs = np.random.default_rng(0).uniform(-1, 1, (batch or 1, *size)).astype(np.float32)
    if to == "onnx":
        with for_any_device():
            metadata = {name: json.dumps(value) for name, value in told.items()}
            model = onnx_model(network, inputs.shape, name="generator", metadata=metadata)
        content = model.SerializeToString()
        found = _run_onnx(content, inputs)
    else:
        content = _stablehlo(network, batch, size)
        found = np.asarray(jax.export.deserialize(bytearray(content)).call(inputs))
    with replacing(path) as temporary:
        temporary.write_bytes(content)
    write_text(path.with_suffix(path.suffix + ".json"), json.dumps(told, indent=2) + "\n")
    own = np.asarray(sensor.generate(sensor.params, inputs))
    return Exported(path, len(content), None if found is None else float(np.abs(found - own).max()))


def describe(sensor: LearnedSensor) -> dict[str, Any]:
    """Each channel's name, the size, and what the outputs mean."""
    prepare = sensor.run.experiment.prepare
    names = []
    for name in prepare.inputs:
        count = CHANNELS[name] or len(prepare.classes)
        kinds = [f"{name} {k}" for k in (range(count) if CHANNELS[name] else prepare.classes)]
        names += [name] if count == 1 else kinds
    distribution = sensor.run.experiment.generator.channels > len(LEVELS)
    meaning = (
        f"quantiles {', '.join(map(str, LEVELS))} of the intensity as 2 x - 1, then the logit of a drop"
        if distribution
        else "intensity as 2 x - 1; below 0.005 the ray does not come back"
    )
    return {
        "inputs": names,
        "rows": prepare.network_size[0],
        "columns": prepare.network_size[1],
        "max_range_m": prepare.max_range_m,
        "outputs": meaning,
        "sensor": sensor.fingerprint,
    }


def _stablehlo(network: Network, batch: int | None, size: tuple[int, ...]) -> bytes:
    need("flatbuffers", "portable", by="convert")  # jax.export writes with it, and says less where it is missing
    shape = jax.export.symbolic_shape("b, " + ", ".join(map(str, size))) if batch is None else (batch, *size)
    with for_any_device():
        made = jax.export.export(jax.jit(network), platforms=PLATFORMS)(jax.ShapeDtypeStruct(shape, np.float32))
    return bytes(made.serialize())


def _run_onnx(content: bytes, inputs: Float[np.ndarray, "b h w c"]) -> Float[np.ndarray, "b h w k"] | None:
    try:
        import onnxruntime
    except ModuleNotFoundError:
        return None
    session = onnxruntime.InferenceSession(content, providers=["CPUExecutionProvider"])
    return np.asarray(session.run(None, {"inputs": inputs})[0])
