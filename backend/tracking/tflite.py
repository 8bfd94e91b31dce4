"""Reads a TensorFlow Lite file of a convolutional network: its constants, and its steps in order.

Field numbers and operator codes are those of the format's public schema, version 3. Constants are stored in half
precision and dequantised by steps of their own, which are taken out here.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..records.errors import LiveHandError
from .flatbuffer import FlatTable

_DTYPES = {0: "<f4", 1: "<f2", 2: "<i4"}
_ACTIVATIONS = {0: "none", 1: "relu", 3: "relu6"}
_PADDINGS = {0: "same", 1: "valid"}
_DEQUANTIZE = 6


@dataclass(frozen=True)
class Network:
    """A network as plain data.

    Attributes:
        steps: of one operator each: `kind`, `inputs` and `output` (numbers of tensors), and its options.
        constants: arrays by the number of their tensor, as the file has them.
        input: number of the input tensor.
        outputs: numbers of the output tensors.
        size_px: side of the square input.
    """

    steps: list[dict[str, Any]]
    constants: dict[int, np.ndarray]
    input: int
    outputs: list[int]
    size_px: int


def read_network(raw: bytes) -> Network:
    """Read the network in a `.tflite` file.

    Raises:
        LiveHandError: the file is damaged, or has an operator that no hand tracker uses.
    """
    model = FlatTable.root(raw)
    codes = [max(code.scalar(0, "<b"), code.scalar(3)) for code in model.tables(1)]
    buffers, graphs = model.tables(4), model.tables(2)
    if not graphs or not buffers:
        raise LiveHandError("a network's file must hold a graph and its weights, got none; fetch it again")
    tensors, operators = graphs[0].tables(0), graphs[0].tables(3)
    try:
        constants = _constants(tensors, buffers)
        same = {
            int(step.numbers(2)[0]): int(step.numbers(1)[0])
            for step in operators
            if codes[step.scalar(0, "<I")] == _DEQUANTIZE
        }
        steps = [
            _step(operator, codes[operator.scalar(0, "<I")], same, tensors, constants)
            for operator in operators
            if codes[operator.scalar(0, "<I")] != _DEQUANTIZE
        ]
        used = {number for step in steps for number in step["inputs"]}
        (entry,) = graphs[0].numbers(1).tolist()
        outputs = graphs[0].numbers(2).tolist()
        size_px = int(tensors[entry].numbers(0)[1])
    except (IndexError, KeyError, ValueError) as error:
        raise LiveHandError(f"a network's file must name its own parts, got {error!r}; fetch it again") from error
    return Network(steps, {number: constants[number] for number in used & constants.keys()}, entry, outputs, size_px)


def _constants(tensors: list[FlatTable], buffers: list[FlatTable]) -> dict[int, np.ndarray]:
    found: dict[int, np.ndarray] = {}
    for number, tensor in enumerate(tensors):
        content = buffers[tensor.scalar(2, "<I")].numbers(0, "u1")
        if len(content):
            found[number] = content.view(_DTYPES[tensor.scalar(1, "<b")]).reshape(tensor.numbers(0))
    return found


def _step(
    operator: FlatTable, code: int, same: dict[int, int], tensors: list[FlatTable], constants: dict[int, np.ndarray]
) -> dict[str, Any]:
    if code not in _KINDS:
        raise LiveHandError(f"a network must have the operators of a hand tracker, got number {code}; fetch it again")
    kind, options_of = _KINDS[code]
    given: list[int] = operator.numbers(1).tolist()
    inputs = [same.get(number, number) for number in given]
    (output,) = operator.numbers(2).tolist()
    table = operator.table(4)
    options = options_of(table) if table else {}
    if kind in ("reshape", "resize"):
        options["shape"] = tensors[output].numbers(0).tolist()
        inputs = inputs[:1]
    elif kind == "pad":
        options["widths"] = constants[inputs[1]].tolist()
        inputs = inputs[:1]
    elif kind == "mean":
        if sorted(constants[inputs[1]].tolist()) != [1, 2]:
            raise LiveHandError("a network's mean must be over the picture; fetch it again")
        inputs = inputs[:1]
    return {"kind": kind, "inputs": inputs, "output": output, **options}


def _conv(table: FlatTable) -> dict[str, Any]:
    return _window(table) | {"activation": _ACTIVATIONS[table.scalar(3, "<b")]}


def _depthwise(table: FlatTable) -> dict[str, Any]:
    return _window(table) | {"activation": _ACTIVATIONS[table.scalar(4, "<b")]}


def _pool(table: FlatTable) -> dict[str, Any]:
    return _window(table) | {"size": [table.scalar(4), table.scalar(3)]}


def _window(table: FlatTable) -> dict[str, Any]:
    return {"padding": _PADDINGS[table.scalar(0, "<b")], "stride": [table.scalar(2), table.scalar(1)]}


def _activation(table: FlatTable) -> dict[str, Any]:
    return {"activation": _ACTIVATIONS[table.scalar(0, "<b")]}


def _resize(table: FlatTable) -> dict[str, Any]:
    if table.scalar(2, "<b") or not table.scalar(3, "<b"):
        raise LiveHandError("a network must resize about the centres of pixels; fetch it again")
    return {}


def _none(_table: FlatTable) -> dict[str, Any]:
    return {}


_KINDS: dict[int, tuple[str, Callable[[FlatTable], dict[str, Any]]]] = {
    0: ("add", _activation),
    2: ("concat", lambda table: {"axis": table.scalar(0)}),
    3: ("conv", _conv),
    4: ("depthwise", _depthwise),
    9: ("dense", _activation),
    14: ("sigmoid", _none),
    17: ("max_pool", _pool),
    22: ("reshape", _none),
    23: ("resize", _resize),
    34: ("pad", _none),
    40: ("mean", _none),
    54: ("prelu", _none),
}
