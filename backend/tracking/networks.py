"""Runs a tracker's network in torch. Inside, pictures are [N, 3, H, W]; the `.tflite` counts [N, H, W, C]."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from .tflite import Network

Run = Callable[..., Tensor]


class TorchNetwork(nn.Module):
    """A network of a tracker as a module without gradients."""

    def __init__(self, network: Network):
        super().__init__()
        self.size_px = network.size_px
        self._input, self._outputs = network.input, network.outputs
        self._steps: list[tuple[Run, list[int], int]] = []
        for step in network.steps:
            given = [number for number in step["inputs"] if number not in network.constants]
            weights = [network.constants[number] for number in step["inputs"] if number in network.constants]
            self._steps.append((_KINDS[step["kind"]](step, weights), given, step["output"]))
        self._last = {number: index for index, (_, given, _) in enumerate(self._steps) for number in given}

    @torch.inference_mode()
    def forward(self, pictures: Float[Tensor, "N 3 H W"]) -> list[Tensor]:
        """Compute the outputs for pictures whose values are in [0, 1]."""
        values = {self._input: pictures.contiguous(memory_format=torch.channels_last)}
        for index, (run, given, output) in enumerate(self._steps):
            values[output] = run(*(values[number] for number in given))
            for number in given:
                if self._last[number] == index and number not in self._outputs:
                    values.pop(number, None)
        return [values[number] for number in self._outputs]


def _activated(name: str) -> Callable[[Tensor], Tensor]:
    """Return the activation, which works in place on what was just computed."""
    return {"none": lambda x: x, "relu": torch.relu_, "relu6": lambda x: x.clamp_(0.0, 6.0)}[name]


def _conv(step: dict[str, Any], weights: Sequence[np.ndarray]) -> Run:
    """Build a convolution; the kernel is [out, height, width, in], of a depthwise step [1, height, width, out]."""
    kernel, bias = (torch.from_numpy(array.astype(np.float32)) for array in weights)
    is_depthwise = step["kind"] == "depthwise"
    kernel = kernel.permute(*((3, 0, 1, 2) if is_depthwise else (0, 3, 1, 2)))
    kernel = kernel.contiguous(memory_format=torch.channels_last)
    groups, stride, after = (len(kernel) if is_depthwise else 1), step["stride"], _activated(step["activation"])

    def run(x: Tensor) -> Tensor:
        before = _same_padding(x, kernel.shape[2:], stride) if step["padding"] == "same" else [0, 0, 0, 0]
        if before[0] == before[1] and before[2] == before[3]:
            return after(F.conv2d(x, kernel, bias, stride, (before[2], before[0]), 1, groups))
        return after(F.conv2d(F.pad(x, before), kernel, bias, stride, 0, 1, groups))

    return run


def _same_padding(x: Tensor, kernel: Sequence[int], stride: Sequence[int]) -> list[int]:
    """Compute the padding at the left, right, top and bottom; an odd pixel is added behind."""
    sides = []
    for size, width, step in zip(x.shape[:1:-1], kernel[::-1], stride[::-1], strict=True):
        total = max((-(-size // step) - 1) * step + width - size, 0)
        sides += [total // 2, total - total // 2]
    return sides


def _dense(step: dict[str, Any], weights: Sequence[np.ndarray]) -> Run:
    kernel, bias = (torch.from_numpy(array.astype(np.float32)) for array in weights)
    after = _activated(step["activation"])
    return lambda x: after(F.linear(x.flatten(1), kernel, bias))


def _add(step: dict[str, Any], _weights: Sequence[np.ndarray]) -> Run:
    after = _activated(step["activation"])
    return lambda x, y: after(x + y)


def _prelu(_step: dict[str, Any], weights: Sequence[np.ndarray]) -> Run:
    slope = torch.from_numpy(weights[0].astype(np.float32).ravel())
    return lambda x: F.prelu(x, slope)


def _max_pool(step: dict[str, Any], _weights: Sequence[np.ndarray]) -> Run:
    return lambda x: F.max_pool2d(x, step["size"], step["stride"])


def _pad(step: dict[str, Any], _weights: Sequence[np.ndarray]) -> Run:
    batch, height, width, channels = step["widths"]
    return lambda x: F.pad(x, [*width, *height, *channels, *batch])


def _resize(step: dict[str, Any], _weights: Sequence[np.ndarray]) -> Run:
    return lambda x: F.interpolate(x, step["shape"][1:3], mode="bilinear", align_corners=False)


def _reshape(step: dict[str, Any], _weights: Sequence[np.ndarray]) -> Run:
    return lambda x: x.permute(0, 2, 3, 1).reshape(len(x), *step["shape"][1:])


def _concat(step: dict[str, Any], _weights: Sequence[np.ndarray]) -> Run:
    """Build a concatenation, only of what has been reshaped, so that axes are the file's own."""
    return lambda *parts: torch.cat(parts, step["axis"])


_KINDS: dict[str, Callable[[dict[str, Any], Sequence[np.ndarray]], Run]] = {
    "add": _add,
    "concat": _concat,
    "conv": _conv,
    "dense": _dense,
    "depthwise": _conv,
    "max_pool": _max_pool,
    "mean": lambda _step, _weights: lambda x: x.mean((2, 3)),
    "pad": _pad,
    "prelu": _prelu,
    "reshape": _reshape,
    "resize": _resize,
    "sigmoid": lambda _step, _weights: torch.sigmoid,
}
