"""Super-resolution where the hand is: the networks' convolutions over one run of pixels a row, in bf16.

What lies farther than a pixel from the hand is taken for a picture of nothing, in every layer.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn

from ..nerf.backend import Precision, in_precision
from ..nerf.superres import ResidualSuperRes
from .kernels.compiled import in_parallel
from .kernels.convolution import (
    CHANNELS,
    SLOPE,
    SPARE,
    convolve_hidden,
    convolve_last,
    fill_around,
    find_runs,
    load_maps,
)
from .kernels.vectors import has_bf16_products


def superres(network: nn.Module, device: torch.device, precision: Precision) -> Callable[[Tensor], Tensor]:
    """The network as a function of its maps: by the kernels, where they and its layers fit; its weights are copied."""
    is_exact = precision != "bf16" or not has_bf16_products()
    if isinstance(network, ResidualSuperRes) and network.config.width == CHANNELS and not is_exact:
        return RowSuperRes.of(network)
    return in_precision(network, device, precision)


@dataclass(frozen=True)
class PackedLayer:
    """A convolution of 3 x 3 pixels.

    Attributes:
        weights: bf16 as uint16 [9, pairs of input channels, 64, 2].
        bias: [64].
        of_nothing: bf16 as uint16 [C], the input far from any hand.
        is_residual: whether the input is added.
    """

    weights: np.ndarray
    bias: np.ndarray
    of_nothing: np.ndarray
    is_residual: bool


@dataclass(frozen=True)
class RowSuperRes:
    """`network`, as a function of maps [1, C, h, w]."""

    network: ResidualSuperRes
    layers: tuple[PackedLayer, ...]

    @classmethod
    def of(cls, network: ResidualSuperRes) -> RowSuperRes:
        """The network with its weights packed."""
        layers, nothing = [], torch.zeros(_even(network.head.in_channels))
        for layer in (network.head, *network.body):
            assert isinstance(layer, nn.Conv2d)
            packed, answer = _packed(layer, nothing, is_residual=layer is not network.head)
            layers.append(packed)
            nothing = answer
        channels = network.tail.out_channels // 4
        order = torch.arange(4 * channels).reshape(channels, 4).T.flatten()  # the four pixels one after the other
        layers.append(_packed(network.tail, nothing, is_residual=False, order=order)[0])
        return cls(network, tuple(layers))

    def __call__(self, maps: Float[Tensor, "1 C h w"]) -> Float[Tensor, "1 D H W"]:
        """As the network; beside the hand its residual is zero."""
        maps = maps.float()
        return self.network.added(maps, self.residual(maps))

    def residual(self, maps: Float[Tensor, "1 C h w"]) -> Float[Tensor, "1 D H W"]:
        """As `ResidualSuperRes.residual`."""
        planes = maps[0].numpy()
        height, width = planes.shape[1:]
        runs = np.zeros((height, 2), np.int64)
        find_runs(planes[-1], runs)
        *hidden, last = self.layers
        image = _image(height, width, 2 * hidden[0].weights.shape[1])
        _in_rows(partial(load_maps, planes, runs), height, image)
        for layer in hidden:
            _in_rows(partial(fill_around, runs, layer.of_nothing), height + 2, image)
            answer = _image(height, width, CHANNELS)
            convolve = partial(convolve_hidden, image, layer.weights, layer.bias, layer.is_residual, runs)
            _in_rows(convolve, height, answer)
            image = answer
        _in_rows(partial(fill_around, runs, last.of_nothing), height + 2, image)
        out = torch.zeros(2 * height, 2 * width, self.network.tail.out_channels // 4)
        _in_rows(partial(convolve_last, image, last.weights, last.bias, runs), height, out.numpy())
        return out.permute(2, 0, 1)[None]


def _in_rows(kernel: Callable[[int, int, np.ndarray], None], rows: int, out: np.ndarray) -> None:
    in_parallel(lambda first, last: kernel(first, last, out), rows, torch.get_num_threads())


def _image(height: int, width: int, channels: int) -> np.ndarray:
    """Not filled."""
    return np.empty((height + 2, width + 2 + SPARE, channels), np.uint16)


def _packed(
    layer: nn.Conv2d, nothing: Tensor, is_residual: bool, order: Tensor | None = None
) -> tuple[PackedLayer, Tensor]:
    """The layer, given its input far from any hand, and its answer there; `order` rearranges its outputs."""
    weight, bias = layer.weight.detach().float().cpu(), _array_of(layer.bias)
    if order is not None:
        weight, bias = weight[order], bias[order]
    padded = torch.zeros(CHANNELS, len(nothing), 3, 3)
    padded[: len(weight), : weight.shape[1]] = weight
    biases = torch.zeros(CHANNELS)
    biases[: len(bias)] = bias
    pairs = padded.permute(2, 3, 1, 0).reshape(9, -1, 2, CHANNELS).transpose(2, 3)
    answer = torch.nn.functional.leaky_relu(padded.bfloat16().float().sum((2, 3)) @ nothing + biases, SLOPE)
    packed = PackedLayer(_bf16(pairs), biases.numpy(), _bf16(nothing), is_residual)
    return packed, (answer + nothing if is_residual else answer).bfloat16().float()


def _bf16(values: Tensor) -> np.ndarray:
    return values.contiguous().bfloat16().view(torch.uint16).numpy()


def _array_of(bias: Tensor | None) -> Tensor:
    assert bias is not None  # the networks' convolutions all have one
    return bias.detach().float().cpu()


def _even(channels: int) -> int:
    return channels + channels % 2
