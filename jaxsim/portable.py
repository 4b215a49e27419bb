"""A run's network as a file for others: StableHLO, which JAX's own `jax.export` reads anywhere, and ONNX.

Both hold the weights and one function, inputs (b, h, w, channels) in float32 to outputs (b, h, w, k); beside either
lies a `.json` that says what the channels are. What makes these inputs from a camera's view is `jaxsim.prepare`.

An ONNX graph is a traced function, each of JAX's primitives by what ONNX has, constants worked out beforehand. It
covers what the networks here are made of and says so where something else comes up. ONNX lays images out with channels
before rows; JAX's `transpose` around a convolution is written as it stands, and a runtime takes pairs away.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, NamedTuple

import jax
import numpy as np
from jax.extend import core
from jaxtyping import Float

from jaxsim.config import QUANTILES
from jaxsim.files import need, replacing, write_text
from jaxsim.frame import LOST_BELOW, Array
from jaxsim.pix2pix import make_generate
from jaxsim.pix2pix.convolution import for_any_device
from jaxsim.prepare import INPUT_CHANNELS, input_channels
from jaxsim.simulate import LearnedSensor

_Form = Literal["stablehlo", "onnx"]
PLATFORMS = ("cpu", "cuda", "tpu")
_Network = Callable[[Array], Array]
OPSET = 18
_Value = np.ndarray | str
"""A constant, or the name of what a node gives."""
INLINED = ("jit", "closed_call", "custom_jvp_call", "custom_vjp_call")
TWINS = {
    "add": "Add", "sub": "Sub", "mul": "Mul", "div": "Div", "max": "Max", "min": "Min", "pow": "Pow", "neg": "Neg",
    "exp": "Exp", "log": "Log", "tanh": "Tanh", "sqrt": "Sqrt", "abs": "Abs", "sign": "Sign", "logistic": "Sigmoid",
    "erf": "Erf", "floor": "Floor", "stop_gradient": "Identity", "copy": "Identity", "copy_p": "Identity",
    "lt": "Less", "le": "LessOrEqual", "gt": "Greater", "ge": "GreaterOrEqual", "eq": "Equal", "and": "And", "or": "Or",
    "not": "Not",
}  # fmt: skip
"""Primitives with a twin: operands of one shape, or scalars."""
REDUCED = {"reduce_sum": "ReduceSum", "reduce_max": "ReduceMax", "reduce_min": "ReduceMin"}


@dataclass(frozen=True)
class Exported:
    """What was written."""

    path: Path
    size: int
    """Bytes."""
    difference: float | None
    """The largest between what the file's network and the run's give of one input; None where nothing here can run
    the file."""


def export_network(learned: LearnedSensor, path: Path, *, to: _Form, batch: int | None = None) -> Exported:
    """Writes the run's network, and beside it what its channels are.

    StableHLO takes any batch unless one is given, and lowers for CPU, CUDA and TPU; ONNX takes the batch given, by
    default 1. Raises ModuleNotFoundError without what writes the file, ValueError for a batch below 1 and for a `path`
    that does not end on its form, as files of the run itself do.
    """
    if path.suffix != f".{to}":
        raise ValueError(f"convert: --to {to} writes NAME.{to}, and --out is {path}")
    if batch is not None and batch < 1:
        raise ValueError(f"convert: a batch of {batch}; give 1 or more")
    experiment = learned.run.experiment
    channels = input_channels(experiment.prepare)
    size = (*experiment.prepare.network_size, channels)
    description = describe_network(learned)
    # Another function than the sensor's own, which may have been traced for this machine's device already.
    generate = make_generate(experiment, channels)
    network: _Network = lambda inputs: generate(learned.params, inputs)  # noqa: E731
    inputs = np.random.default_rng(0).uniform(-1, 1, (batch or 1, *size)).astype(np.float32)
    if to == "onnx":
        with for_any_device():
            metadata = {name: json.dumps(value) for name, value in description.items()}
            model = onnx_model(network, inputs.shape, name="generator", metadata=metadata)
        content = model.SerializeToString()
        exported = _run_onnx(content, inputs)
    else:
        content = _stablehlo(network, batch, size)
        exported = np.asarray(jax.export.deserialize(bytearray(content)).call(inputs))
    with replacing(path) as temporary:
        temporary.write_bytes(content)
    write_text(path.with_suffix(path.suffix + ".json"), json.dumps(description, indent=2) + "\n")
    ours = np.asarray(learned.generate(learned.params, inputs))
    return Exported(path, len(content), None if exported is None else float(np.abs(exported - ours).max()))


def describe_network(learned: LearnedSensor) -> dict[str, Any]:
    """Each channel's name, the size, and what the outputs mean."""
    prepare = learned.run.experiment.prepare
    names = []
    for name in prepare.inputs:
        count = INPUT_CHANNELS[name] or len(prepare.classes)
        kinds = [f"{name} {k}" for k in (range(count) if INPUT_CHANNELS[name] else prepare.classes)]
        names += [name] if count == 1 else kinds
    distribution = learned.run.experiment.generator.channels > len(QUANTILES)
    meaning = (
        f"quantiles {', '.join(map(str, QUANTILES))} of the intensity as 2 x - 1, then the logit of a drop"
        if distribution
        else f"intensity as 2 x - 1; below {LOST_BELOW} the ray does not come back"
    )
    return {
        "inputs": names,
        "rows": prepare.network_size[0],
        "columns": prepare.network_size[1],
        "max_range_m": prepare.max_range_m,
        "outputs": meaning,
        "sensor": learned.fingerprint,
    }


def _stablehlo(network: _Network, batch: int | None, size: tuple[int, ...]) -> bytes:
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


@dataclass
class Graph:
    """Nodes as they come."""

    onnx: Any
    nodes: list[Any] = field(default_factory=list)
    constants: list[Any] = field(default_factory=list)

    def add(self, op: str, *inputs: _Value, **attributes: Any) -> str:
        """A node, and the name of its output."""
        name = f"{op.lower()}_{len(self.nodes)}"
        given = [self.name(value) for value in inputs]
        self.nodes.append(self.onnx.helper.make_node(op, given, [name], **attributes))
        return name

    def name(self, value: _Value) -> str:
        """The name of a value: that of a constant, which is put into the file, or of what is there already."""
        if isinstance(value, str):
            return value
        name = f"constant_{len(self.constants)}"
        self.constants.append(self.onnx.numpy_helper.from_array(np.ascontiguousarray(value), name))
        return name


def onnx_model(
    function: Callable[[Any], Any], shape: tuple[int, ...], *, name: str, metadata: Mapping[str, str]
) -> Any:
    """The ONNX model of a function of one float32 array to one: `inputs` to `outputs`.

    Raises ModuleNotFoundError without onnx, NotImplementedError for a primitive that has no translation here.
    """
    onnx = need("onnx", "portable", by="convert")
    closed = jax.make_jaxpr(function)(jax.ShapeDtypeStruct(shape, np.float32))
    graph = Graph(onnx)
    (result,) = _walk(graph, closed, ["inputs"])
    graph.nodes.append(onnx.helper.make_node("Identity", [graph.name(result)], ["outputs"]))
    value_info = onnx.helper.make_tensor_value_info
    kind = onnx.TensorProto.FLOAT
    made = onnx.helper.make_graph(
        graph.nodes,
        name,
        [value_info("inputs", kind, shape)],
        [value_info("outputs", kind, closed.out_avals[0].shape)],
        initializer=graph.constants,
    )
    opsets = [onnx.helper.make_opsetid("", OPSET)]
    # The oldest version of the format that has this opset, for runtimes that are not new.
    model = onnx.helper.make_model(made, opset_imports=opsets, ir_version=8, producer_name="jaxsim")
    onnx.helper.set_model_props(model, dict(metadata))
    onnx.checker.check_model(model, full_check=True)
    return model


def _walk(graph: Graph, closed: core.ClosedJaxpr, inputs: Sequence[_Value]) -> list[_Value]:
    jaxpr = closed.jaxpr
    constants = zip(jaxpr.constvars, map(np.asarray, closed.consts), strict=True)
    known: dict[Any, _Value] = {**dict(constants), **dict(zip(jaxpr.invars, inputs, strict=True))}
    read = lambda at: np.asarray(at.val) if isinstance(at, core.Literal) else known[at]  # noqa: E731
    for equation in jaxpr.eqns:
        given = [read(at) for at in equation.invars]
        results = _equation(graph, equation, given)
        known |= dict(zip(equation.outvars, results, strict=True))
    return [read(at) for at in jaxpr.outvars]


def _equation(graph: Graph, equation: Any, given: list[_Value]) -> list[_Value]:
    name, parameters = equation.primitive.name, equation.params
    if name in INLINED:
        inner = next(parameters[k] for k in ("jaxpr", "call_jaxpr") if k in parameters)
        closed = inner if isinstance(inner, core.ClosedJaxpr) else core.ClosedJaxpr(inner, [])
        return _walk(graph, closed, given)
    if not any(isinstance(value, str) for value in given):
        results = equation.primitive.bind(*given, **parameters)
        return [np.asarray(one) for one in (results if equation.primitive.multiple_results else [results])]
    shape = tuple(equation.outvars[0].aval.shape)
    if 0 in shape:  # which Reshape would take for "as before"
        return [np.zeros(shape, equation.outvars[0].aval.dtype)]
    if name in TWINS:
        return [graph.add(TWINS[name], *given)]
    if name in REDUCED:
        return [graph.add(REDUCED[name], given[0], np.array(parameters["axes"], np.int64), keepdims=0)]
    if name not in TRANSLATED:
        raise NotImplementedError(
            f"convert: {name} of the network has no translation to ONNX here; --to stablehlo has all"
        )
    shapes = [tuple(at.aval.shape) for at in equation.invars]
    return [TRANSLATED[name](Operation(graph, given, shapes, shape, parameters))]


class Operation(NamedTuple):
    """A primitive of the function, to become nodes of a graph."""

    graph: Graph
    given: list[Any]
    """Its operands: constants, or names of what nodes give."""
    shapes: list[tuple[int, ...]]
    """Shapes of the operands."""
    shape: tuple[int, ...]
    """Shape of the result."""
    parameters: Mapping[str, Any]


def _reshape(op: Operation) -> str:
    return op.graph.add("Reshape", op.given[0], np.array(op.shape, np.int64))


def _broadcast(op: Operation) -> str:
    ones = [1] * len(op.shape)
    for axis, size in zip(op.parameters["broadcast_dimensions"], op.shapes[0], strict=True):
        ones[axis] = size
    spread = (
        op.graph.add("Reshape", op.given[0], np.array(ones, np.int64)) if tuple(ones) != op.shapes[0] else op.given[0]
    )
    return op.graph.add("Expand", spread, np.array(op.shape, np.int64))


def _concatenate(op: Operation) -> str:
    some = [value for value, size in zip(op.given, op.shapes, strict=True) if 0 not in size]
    return op.graph.add("Concat", *some, axis=int(op.parameters["dimension"]))


def _stack(op: Operation) -> str:
    axis = int(op.parameters["axis"])
    one = np.array((*op.shape[:axis], 1, *op.shape[axis + 1 :]), np.int64)
    return op.graph.add("Concat", *[op.graph.add("Reshape", value, one) for value in op.given], axis=axis)


def _slice(op: Operation) -> str:
    starts, stops = op.parameters["start_indices"], op.parameters["limit_indices"]
    steps = op.parameters["strides"] or [1] * len(starts)
    axes = range(len(starts))
    return op.graph.add("Slice", op.given[0], *(np.array(tuple(v), np.int64) for v in (starts, stops, axes, steps)))


def _reverse(op: Operation) -> str:
    axes = np.array(op.parameters["dimensions"], np.int64)
    first = np.full(len(axes), -1, np.int64)
    before = np.full(len(axes), np.iinfo(np.int64).min, np.int64)
    return op.graph.add("Slice", op.given[0], first, before, axes, first)


def _pad(op: Operation) -> str:
    low, high, between = np.array(op.parameters["padding_config"], np.int64).T
    if between.any() or min(low.min(), high.min()) < 0:
        raise NotImplementedError("convert: padding between cells or less than none has no translation to ONNX here")
    return op.graph.add("Pad", op.given[0], np.concatenate([low, high]), op.given[1], mode="constant")


def _gather(op: Operation) -> str:
    """Whole slices at known places of one axis: what indexing with a list is."""
    numbers, sizes = op.parameters["dimension_numbers"], op.parameters["slice_sizes"]
    axes = numbers.start_index_map
    full = [1 if k in axes else size for k, size in enumerate(op.shapes[0])]
    if isinstance(op.given[1], str) or len(axes) != 1 or numbers.collapsed_slice_dims != axes or full != list(sizes):
        raise NotImplementedError("convert: indexing of several axes has no translation to ONNX here")
    (axis,) = axes
    places = np.clip(op.given[1].reshape(-1), 0, op.shapes[0][axis] - 1).astype(np.int64)
    gathered = op.graph.add("Gather", op.given[0], places, axis=axis)
    [batch] = [k for k in range(len(op.shape)) if k not in numbers.offset_dims]
    order = [k for k in range(len(op.shape)) if k != axis]
    order.insert(batch, axis)
    return gathered if order == sorted(order) else op.graph.add("Transpose", gathered, perm=order)


def _product(op: Operation) -> str:
    (left, right), (left_batch, right_batch) = op.parameters["dimension_numbers"]
    letters = iter("abcdefghijklmnopqrstuvwxyz")
    a = [next(letters) for _ in op.shapes[0]]
    b = [next(letters) for _ in op.shapes[1]]
    for i, j in [*zip(left, right, strict=True), *zip(left_batch, right_batch, strict=True)]:
        b[j] = a[i]
    batch = [a[i] for i in left_batch]
    rest = [a[i] for i in range(len(a)) if i not in (*left, *left_batch)]
    rest += [b[j] for j in range(len(b)) if j not in (*right, *right_batch)]
    return op.graph.add("Einsum", *op.given, equation=f"{''.join(a)},{''.join(b)}->{''.join(batch + rest)}")


def _convolve(op: Operation) -> str:
    numbers = op.parameters["dimension_numbers"]
    x = op.graph.add("Transpose", op.given[0], perm=list(numbers.lhs_spec))
    kernel = op.given[1]
    if isinstance(kernel, str) or op.parameters["batch_group_count"] != 1:
        raise NotImplementedError("convert: a convolution whose kernel is not known has no translation to ONNX here")
    kernel = kernel.transpose(numbers.rhs_spec)  # out, in, rows, columns
    low = [before for before, _ in op.parameters["padding"]]
    high = [after for _, after in op.parameters["padding"]]
    spread = list(op.parameters["rhs_dilation"])
    shared = {"group": op.parameters["feature_group_count"], "dilations": spread}
    if all(step == 1 for step in op.parameters["lhs_dilation"]):
        pads = [*low, *high]
        y = op.graph.add("Conv", x, kernel, strides=list(op.parameters["window_strides"]), pads=pads, **shared)
    else:
        # Zeros between the cells: the transposed convolution, whose kernel is turned and whose padding is what is
        # missing to a whole kernel.
        reach = [(size - 1) * step for size, step in zip(kernel.shape[2:], spread, strict=True)]
        pads = [*(r - p for r, p in zip(reach, low, strict=True)), *(r - p for r, p in zip(reach, high, strict=True))]
        if min(pads) < 0 or shared["group"] != 1 or any(step != 1 for step in op.parameters["window_strides"]):
            raise NotImplementedError("convert: this transposed convolution has no translation to ONNX here")
        turned = kernel[:, :, ::-1, ::-1].swapaxes(0, 1)
        y = op.graph.add("ConvTranspose", x, turned, strides=list(op.parameters["lhs_dilation"]), pads=pads, **shared)
    return op.graph.add("Transpose", y, perm=[int(k) for k in np.argsort(numbers.out_spec)])


def _cast(op: Operation) -> str:
    kind = op.graph.onnx.helper.np_dtype_to_tensor_dtype(np.dtype(op.parameters["new_dtype"]))
    return op.graph.add("Cast", op.given[0], to=kind)


TRANSLATED: dict[str, Callable[[Operation], str]] = {
    "reshape": _reshape, "squeeze": _reshape, "expand_dims": _reshape, "broadcast_in_dim": _broadcast,
    "concatenate": _concatenate, "stack": _stack, "slice": _slice, "rev": _reverse,
    "pad": _pad, "gather": _gather, "dot_general": _product, "conv_general_dilated": _convolve,
    "convert_element_type": _cast,
    "transpose": lambda op: op.graph.add("Transpose", op.given[0], perm=[int(k) for k in op.parameters["permutation"]]),
    "select_n": lambda op: op.graph.add("Where", op.given[0], op.given[2], op.given[1]),  # it gives what is false first
    "integer_pow": lambda op: op.graph.add("Pow", op.given[0], np.asarray(op.parameters["y"], np.float32)),
    "rsqrt": lambda op: op.graph.add("Reciprocal", op.graph.add("Sqrt", op.given[0])),
    "square": lambda op: op.graph.add("Mul", op.given[0], op.given[0]),
}  # fmt: skip
