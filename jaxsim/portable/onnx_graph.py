"""A traced function as an ONNX graph: each of JAX's primitives by what ONNX has, constants worked out beforehand.

It covers what the networks here are made of and says so where something else comes up. ONNX lays images out with
channels before rows; JAX's `transpose` around a convolution is written as it stands, and a runtime takes pairs away.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import jax
import numpy as np
from jax.extend.core import ClosedJaxpr, Jaxpr, Literal

from jaxsim.files import need

OPSET = 18
Value = np.ndarray | str
"""A constant, or the name of what a node gives."""
INLINED = (
    "jit",
    "pjit",
    "closed_call",
    "custom_jvp_call",
    "custom_vjp_call",
    "custom_vjp_call_jaxpr",
    "remat",
    "checkpoint",
)
SAME = {
    "add": "Add", "sub": "Sub", "mul": "Mul", "div": "Div", "max": "Max", "min": "Min", "pow": "Pow", "neg": "Neg",
    "exp": "Exp", "log": "Log", "tanh": "Tanh", "sqrt": "Sqrt", "abs": "Abs", "sign": "Sign", "logistic": "Sigmoid",
    "erf": "Erf", "floor": "Floor", "stop_gradient": "Identity", "copy": "Identity", "copy_p": "Identity",
    "lt": "Less", "le": "LessOrEqual", "gt": "Greater", "ge": "GreaterOrEqual", "eq": "Equal", "and": "And", "or": "Or",
    "not": "Not",
}  # fmt: skip
"""Primitives with a twin: operands of one shape, or scalars."""
REDUCED = {"reduce_sum": "ReduceSum", "reduce_max": "ReduceMax", "reduce_min": "ReduceMin"}


@dataclass
class Graph:
    """Nodes as they come."""

    onnx: Any
    nodes: list[Any] = field(default_factory=list)
    kept: list[Any] = field(default_factory=list)

    def add(self, op: str, *inputs: Value, **attributes: Any) -> str:
        """A node, and the name of its output."""
        name = f"{op.lower()}_{len(self.nodes)}"
        given = [self.name(value) for value in inputs]
        self.nodes.append(self.onnx.helper.make_node(op, given, [name], **attributes))
        return name

    def name(self, value: Value) -> str:
        """Of a constant, which is put into the file, or of what is there."""
        if isinstance(value, str):
            return value
        name = f"constant_{len(self.kept)}"
        self.kept.append(self.onnx.numpy_helper.from_array(np.ascontiguousarray(value), name))
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
    (result,) = _walk(graph, closed.jaxpr, [np.asarray(c) for c in closed.consts], ["inputs"])
    graph.nodes.append(onnx.helper.make_node("Identity", [graph.name(result)], ["outputs"]))
    told = onnx.helper.make_tensor_value_info
    kind = onnx.TensorProto.FLOAT
    made = onnx.helper.make_graph(
        graph.nodes,
        name,
        [told("inputs", kind, shape)],
        [told("outputs", kind, closed.out_avals[0].shape)],
        initializer=graph.kept,
    )
    opsets = [onnx.helper.make_opsetid("", OPSET)]
    # The oldest version of the format that has this opset, for runtimes that are not new.
    model = onnx.helper.make_model(made, opset_imports=opsets, ir_version=8, producer_name="jaxsim")
    onnx.helper.set_model_props(model, dict(metadata))
    onnx.checker.check_model(model, full_check=True)
    return model


def _walk(graph: Graph, jaxpr: Jaxpr, consts: Sequence[Value], inputs: Sequence[Value]) -> list[Value]:
    known: dict[Any, Value] = dict(zip(jaxpr.constvars, consts, strict=True)) | dict(
        zip(jaxpr.invars, inputs, strict=True)
    )
    read = lambda at: np.asarray(at.val) if isinstance(at, Literal) else known[at]  # noqa: E731
    for equation in jaxpr.eqns:
        given = [read(at) for at in equation.invars]
        found = _equation(graph, equation, given)
        known |= dict(zip(equation.outvars, found, strict=True))
    return [read(at) for at in jaxpr.outvars]


def _equation(graph: Graph, equation: Any, given: list[Value]) -> list[Value]:
    name, parameters = equation.primitive.name, equation.params
    if name in INLINED:
        inner = next(parameters[k] for k in ("jaxpr", "call_jaxpr", "fun_jaxpr") if k in parameters)
        closed = inner if isinstance(inner, ClosedJaxpr) else ClosedJaxpr(inner, [])
        return _walk(graph, closed.jaxpr, [np.asarray(c) for c in closed.consts], given)
    if not any(isinstance(value, str) for value in given):
        found = equation.primitive.bind(*given, **parameters)
        return [np.asarray(one) for one in (found if equation.primitive.multiple_results else [found])]
    shape = tuple(equation.outvars[0].aval.shape)
    if 0 in shape:  # which Reshape would take for "as before"
        return [np.zeros(shape, equation.outvars[0].aval.dtype)]
    if name in SAME:
        return [graph.add(SAME[name], *given)]
    if name in REDUCED:
        return [graph.add(REDUCED[name], given[0], np.array(parameters["axes"], np.int64), keepdims=0)]
    if name not in TRANSLATED:
        raise NotImplementedError(
            f"convert: {name} of the network has no translation to ONNX here; --to stablehlo has all"
        )
    shapes = [tuple(at.aval.shape) for at in equation.invars]
    return [TRANSLATED[name](graph, given, shapes, shape, parameters)]


Translation = Callable[[Graph, list[Any], list[tuple[int, ...]], tuple[int, ...], Mapping[str, Any]], str]


def _reshape(graph, given, shapes, shape, parameters) -> str:
    return graph.add("Reshape", given[0], np.array(shape, np.int64))


def _broadcast(graph, given, shapes, shape, parameters) -> str:
    ones = [1] * len(shape)
    for axis, size in zip(parameters["broadcast_dimensions"], shapes[0], strict=True):
        ones[axis] = size
    spread = graph.add("Reshape", given[0], np.array(ones, np.int64)) if tuple(ones) != shapes[0] else given[0]
    return graph.add("Expand", spread, np.array(shape, np.int64))


def _transpose(graph, given, shapes, shape, parameters) -> str:
    return graph.add("Transpose", given[0], perm=[int(axis) for axis in parameters["permutation"]])


def _concatenate(graph, given, shapes, shape, parameters) -> str:
    some = [value for value, size in zip(given, shapes, strict=True) if 0 not in size]
    return graph.add("Concat", *some, axis=int(parameters["dimension"]))


def _stack(graph, given, shapes, shape, parameters) -> str:
    axis = int(parameters["axis"])
    one = np.array((*shape[:axis], 1, *shape[axis + 1 :]), np.int64)
    return graph.add("Concat", *[graph.add("Reshape", value, one) for value in given], axis=axis)


def _slice(graph, given, shapes, shape, parameters) -> str:
    starts, stops = parameters["start_indices"], parameters["limit_indices"]
    steps = parameters["strides"] or [1] * len(starts)
    axes = range(len(starts))
    return graph.add("Slice", given[0], *(np.array(tuple(v), np.int64) for v in (starts, stops, axes, steps)))


def _reverse(graph, given, shapes, shape, parameters) -> str:
    axes = np.array(parameters["dimensions"], np.int64)
    first = np.full(len(axes), -1, np.int64)
    before = np.full(len(axes), np.iinfo(np.int64).min, np.int64)
    return graph.add("Slice", given[0], first, before, axes, first)


def _pad(graph, given, shapes, shape, parameters) -> str:
    low, high, between = (np.array(v, np.int64) for v in zip(*parameters["padding_config"], strict=True))
    if between.any() or min(low.min(), high.min()) < 0:
        raise NotImplementedError("convert: padding between cells or less than none has no translation to ONNX here")
    return graph.add("Pad", given[0], np.concatenate([low, high]), given[1], mode="constant")


def _gather(graph, given, shapes, shape, parameters) -> str:
    """Whole slices at known places of one axis: what indexing with a list is."""
    numbers, sizes = parameters["dimension_numbers"], parameters["slice_sizes"]
    axes = numbers.start_index_map
    whole = all(size == (1 if k in axes else full) for k, (size, full) in enumerate(zip(sizes, shapes[0], strict=True)))
    if isinstance(given[1], str) or len(axes) != 1 or numbers.collapsed_slice_dims != axes or not whole:
        raise NotImplementedError("convert: indexing of several axes has no translation to ONNX here")
    (axis,) = axes
    places = np.clip(given[1].reshape(-1), 0, shapes[0][axis] - 1).astype(np.int64)
    found = graph.add("Gather", given[0], places, axis=axis)
    (batch,) = (k for k in range(len(shape)) if k not in numbers.offset_dims)
    order = [k for k in range(len(shape)) if k != axis]
    order.insert(batch, axis)
    return found if order == sorted(order) else graph.add("Transpose", found, perm=order)


def _product(graph, given, shapes, shape, parameters) -> str:
    (left, right), (left_batch, right_batch) = parameters["dimension_numbers"]
    letters = iter("abcdefghijklmnopqrstuvwxyz")
    a = [next(letters) for _ in shapes[0]]
    b = [next(letters) for _ in shapes[1]]
    for i, j in [*zip(left, right, strict=True), *zip(left_batch, right_batch, strict=True)]:
        b[j] = a[i]
    batch = [a[i] for i in left_batch]
    rest = [a[i] for i in range(len(a)) if i not in (*left, *left_batch)]
    rest += [b[j] for j in range(len(b)) if j not in (*right, *right_batch)]
    return graph.add("Einsum", *given, equation=f"{''.join(a)},{''.join(b)}->{''.join(batch + rest)}")


def _convolve(graph, given, shapes, shape, parameters) -> str:
    numbers = parameters["dimension_numbers"]
    x = graph.add("Transpose", given[0], perm=list(numbers.lhs_spec))
    kernel = given[1]
    if isinstance(kernel, str) or parameters["batch_group_count"] != 1:
        raise NotImplementedError("convert: a convolution whose kernel is not known has no translation to ONNX here")
    kernel = kernel.transpose(numbers.rhs_spec)  # out, in, rows, columns
    low, high = (list(v) for v in zip(*parameters["padding"], strict=True))
    spread = list(parameters["rhs_dilation"])
    shared = {"group": parameters["feature_group_count"], "dilations": spread}
    if all(step == 1 for step in parameters["lhs_dilation"]):
        pads = [*low, *high]
        y = graph.add("Conv", x, kernel, strides=list(parameters["window_strides"]), pads=pads, **shared)
    else:
        # Zeros between the cells: the transposed convolution, whose kernel is turned and whose padding is what is
        # missing to a whole kernel.
        reach = [(size - 1) * step for size, step in zip(kernel.shape[2:], spread, strict=True)]
        pads = [*(r - p for r, p in zip(reach, low, strict=True)), *(r - p for r, p in zip(reach, high, strict=True))]
        if min(pads) < 0 or shared["group"] != 1 or any(step != 1 for step in parameters["window_strides"]):
            raise NotImplementedError("convert: this transposed convolution has no translation to ONNX here")
        turned = kernel[:, :, ::-1, ::-1].swapaxes(0, 1)
        y = graph.add("ConvTranspose", x, turned, strides=list(parameters["lhs_dilation"]), pads=pads, **shared)
    return graph.add("Transpose", y, perm=[int(k) for k in np.argsort(numbers.out_spec)])


def _cast(graph, given, shapes, shape, parameters) -> str:
    kind = graph.onnx.helper.np_dtype_to_tensor_dtype(np.dtype(parameters["new_dtype"]))
    return graph.add("Cast", given[0], to=kind)


def _power(graph, given, shapes, shape, parameters) -> str:
    return graph.add("Pow", given[0], np.float32(parameters["y"]))


def _root(graph, given, shapes, shape, parameters) -> str:
    return graph.add("Reciprocal", graph.add("Sqrt", given[0]))


def _square(graph, given, shapes, shape, parameters) -> str:
    return graph.add("Mul", given[0], given[0])


def _choose(graph, given, shapes, shape, parameters) -> str:
    where, no, yes = given
    return graph.add("Where", where, yes, no)


TRANSLATED: dict[str, Translation] = {
    "reshape": _reshape, "squeeze": _reshape, "expand_dims": _reshape, "broadcast_in_dim": _broadcast,
    "transpose": _transpose, "concatenate": _concatenate, "stack": _stack, "slice": _slice, "rev": _reverse,
    "pad": _pad, "gather": _gather, "dot_general": _product, "conv_general_dilated": _convolve,
    "convert_element_type": _cast, "integer_pow": _power, "rsqrt": _root, "square": _square, "select_n": _choose,
}  # fmt: skip
