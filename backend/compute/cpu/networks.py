"""Networks by kernels, where the processor has the vectors: a field's decoder, and super-resolution where the hand is.

Super-resolution convolves one run of pixels a row. What lies farther than two pixels from the hand is taken for a
picture of nothing, in every layer. In reduced precision all layers multiply int8: a ray's values, or a layer's, are
rounded to 256 steps between their least and largest, and those of the maps and of what is decoded after they were
multiplied by their largest weight, so that each is as exact as it counts.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn.functional import leaky_relu, pad

from ...field.field import MIN_ALPHA, PlaneField
from ...field.relightable import RelightableField
from ...field.volume import Composite
from ...image.superres import ResidualSuperRes
from ...light.lighting import AmbientOcclusion
from ..kernels.networks import (
    CHANNELS,
    GROUP,
    MIDDLE,
    SLOPE,
    SPARE,
    convolve_hidden,
    convolve_last,
    decode_rays,
    fill_around,
    find_runs,
    load_maps,
    quantise,
)
from ..kernels.networks import decoder_inputs as fill_inputs
from ..kernels.vectors import LANES, has_int8_products, has_vectors
from ..precision import Decoder, Precision, decoder_in_precision, in_precision
from ..reference import ReferenceBackend
from .arrays import as_arrays
from .threads import in_parallel, on_all_threads

OUTPUTS = 4 * LANES
"""Of a block at most."""
_MOST, _FOURS = 127, 4


class PackedWeights(NamedTuple):
    """Weights of up to 64 outputs, padded to N.

    Attributes:
        words: [taps, C, N] fp32, or [taps, C / 4, N] int32, four int8 each.
        factors: [N] by which sums of products with these are too small.
        sums: [N] of each output's numbers.
    """

    words: np.ndarray
    factors: np.ndarray
    sums: np.ndarray

    @classmethod
    def of(cls, weight: Float[Tensor, "O C h w"], is_int8: bool, outputs: int = OUTPUTS) -> PackedWeights:
        """Pack weights of so many outputs at most; int8 takes a multiple of four inputs."""
        padded = torch.zeros(outputs, *weight.shape[1:])
        padded[: len(weight)] = weight
        values, factors = padded.permute(2, 3, 1, 0).reshape(-1, weight.shape[1], outputs), torch.ones(outputs)
        if is_int8:
            factors = padded.abs().amax((1, 2, 3)).clamp(min=1e-12) / _MOST
            values = (values / factors).round()
        sums = values.sum((0, 1))
        if is_int8:
            fours = values.to(torch.int8).reshape(len(values), -1, _FOURS, outputs).transpose(2, 3).contiguous()
            values = fours.view(torch.int32)[..., 0]
        return cls(*(one.contiguous().numpy() for one in (values, factors, sums)))


Layer = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""Weights, factors, bias and zeros as `decode_rays` takes them."""


def decoder(field: PlaneField, device: torch.device, precision: Precision) -> Decoder:
    """Make a field's decoder by the kernels; in reduced precision its layers multiply int8."""
    if not has_vectors():
        return on_all_threads(decoder_in_precision(field, device, precision))
    is_int8 = precision == "bf16" and has_int8_products()
    layers, gains = list[Layer](), torch.ones(0)
    for layer in (*field.trunk, field.channels):
        assert isinstance(layer, nn.Linear)
        weight = layer.weight.detach().float().cpu()
        if layers:
            layers.append(_packed(weight, layer, len(layers[-1][2]), is_int8, 0))
        else:
            gains = _gains(weight, is_int8)
            layers.append(_packed(weight / gains, layer, _whole_fours(layer.in_features, is_int8), is_int8, MIDDLE))
    steps = np.full(1, 255, np.uint8) if is_int8 else np.empty(0, np.float32)
    return partial(_decode, gains.numpy(), layers, steps, field.channels.out_features)


def decoder_inputs(
    field: RelightableField, gathered: Composite, view: Float[Tensor, "R 3"], occlusion: AmbientOcclusion
) -> Float[Tensor, "R C"]:
    """Compute the decoder's inputs, as `RelightableField.decoder_inputs`."""
    count, near = len(view), field.near_channels
    inputs = torch.empty(count, near + field.ANGLES)
    rays, out = as_arrays(gathered.channels, gathered.alpha, view, *occlusion), inputs.numpy()
    known = *rays, near, field.normal_slice.start, np.float32(MIN_ALPHA)
    in_parallel(lambda first, last: fill_inputs(*known, first, last, out), count)
    return inputs


def _decode(
    gains: np.ndarray, layers: Sequence[Layer], steps: np.ndarray, outputs: int, inputs: Float[Tensor, "R C"]
) -> Tensor:
    """Decode inputs to [R, outputs]."""
    source, decoded = inputs.float().contiguous().numpy(), torch.empty(len(inputs), outputs)
    out = decoded.numpy()
    in_parallel(lambda first, last: decode_rays(source, gains, *layers, steps, first, last, out), len(out))
    return decoded


def _packed(weight: Tensor, layer: nn.Linear, inputs: int, is_int8: bool, middle: int) -> Layer:
    """Pack a weight with so many inputs, in int8 counted from a middle, and outputs padded to whole groups."""
    outputs = -(-layer.out_features // GROUP) * GROUP
    padded, bias = torch.zeros(outputs, inputs), torch.zeros(outputs)
    padded[: layer.out_features, : layer.in_features] = weight
    bias[: layer.out_features] = layer.bias.detach()
    groups = [PackedWeights.of(rows[:, :, None, None], is_int8) for rows in padded.split(GROUP)]
    words, factors, sums = (np.stack(values) for values in zip(*groups, strict=True))
    zeros = sums.ravel() * np.float32(middle if is_int8 else 0)
    return words, factors.ravel(), bias.numpy(), zeros.astype(words.dtype)


def _gains(weight: Float[Tensor, "O C ..."], is_int8: bool) -> Float[Tensor, " C"]:
    """Return what inputs are multiplied by, and their weights divided, before int8: each one's largest weight."""
    largest = weight.abs().transpose(0, 1).flatten(1).amax(1)
    return largest.clamp(min=_LEAST_WEIGHT) if is_int8 else torch.ones_like(largest)


def _whole_fours(count: int, is_int8: bool) -> int:
    """Return how many inputs a layer of so many is packed with."""
    return -(-count // _FOURS) * _FOURS if is_int8 else count


_LEAST_WEIGHT = 1e-12
_STEPS = np.float32(255)
_LEAST_SPAN = 1e-6


def superres(network: nn.Module, device: torch.device, precision: Precision) -> Callable[[Tensor], Tensor]:
    """Make a function of the network's maps: by the kernels, where they and its layers fit; its weights are copied."""
    if isinstance(network, ResidualSuperRes) and network.config.width in CHANNELS and has_vectors():
        return RowSuperRes.of(network, is_int8=precision == "bf16" and has_int8_products())
    return on_all_threads(in_precision(network, device, precision))


@dataclass(frozen=True)
class PackedLayer:
    """A convolution of 3 x 3 pixels.

    Attributes:
        weights: of 9 taps.
        bias: [N].
        of_nothing: [C] the input far from any hand.
        is_residual: whether the input is added.
    """

    weights: PackedWeights
    bias: np.ndarray
    of_nothing: np.ndarray
    is_residual: bool

    @classmethod
    def of(cls, weight: Tensor, bias: Tensor, of_nothing: Tensor, is_residual: bool, is_int8: bool) -> PackedLayer:
        """Pack a layer of at most 64 outputs."""
        outputs = next(channels for channels in CHANNELS if channels >= len(bias))
        biases = torch.zeros(outputs)
        biases[: len(bias)] = bias
        inputs = _whole_fours(weight.shape[1], is_int8) - weight.shape[1]
        weight, of_nothing = pad(weight, (0, 0, 0, 0, 0, inputs)), pad(of_nothing, (0, inputs))
        return cls(PackedWeights.of(weight, is_int8, outputs), biases.numpy(), of_nothing.numpy(), is_residual)


@dataclass(frozen=True)
class RowSuperRes:
    """`network`, as a function of maps [1, C, h, w], which it multiplies by `gains` [C] first."""

    network: ResidualSuperRes
    gains: np.ndarray
    layers: tuple[PackedLayer, ...]

    @classmethod
    def of(cls, network: ResidualSuperRes, is_int8: bool) -> RowSuperRes:
        """Pack the weights of a network."""
        layers, nothing = [], torch.zeros(network.head.in_channels)
        gains = _gains(_parameters(network.head)[0], is_int8)
        for layer in (network.head, *network.body):
            assert isinstance(layer, nn.Conv2d)
            is_first = layer is network.head
            weight, bias = _parameters(layer)
            weight = weight / gains[:, None, None] if is_first else weight
            layers.append(PackedLayer.of(weight, bias, nothing, not is_first, is_int8))
            answer = leaky_relu(weight.sum((2, 3)) @ nothing + bias, SLOPE)
            nothing = answer if is_first else answer + nothing
        channels = network.tail.out_channels // 4
        order = torch.arange(4 * channels).reshape(channels, 4).T.flatten()  # the four pixels one after the other
        weight, bias = (values.detach().float().cpu()[order] for values in network.even_tail())
        layers.append(PackedLayer.of(weight, bias, nothing, False, is_int8))
        return cls(network, gains.numpy(), tuple(layers))

    def __call__(self, maps: Float[Tensor, "1 C h w"]) -> Float[Tensor, "1 D H W"]:
        """Super-resolve maps as the network does; beside the hand its residual is zero."""
        maps = maps.float()
        return self.network.added(maps, self.residual(maps))

    def residual(self, maps: Float[Tensor, "1 C h w"]) -> Float[Tensor, "1 D H W"]:
        """Compute the residual, as `ResidualSuperRes.residual`."""
        planes = maps[0].numpy()
        height, width = planes.shape[1:]
        runs, bounds = np.zeros((height, 2), np.int64), np.empty((height, 2), np.float32)
        find_runs(planes[-1], runs)
        *hidden, last = self.layers
        image = _image(height, width, len(hidden[0].of_nothing))
        _in_rows(lambda first, end, out: load_maps(planes, self.gains, runs, first, end, bounds, out), height, image)
        for layer in hidden:
            source, answer = _source(layer, image, runs, bounds), _image(height, width, self.network.config.width)
            rows = partial(convolve_hidden, *source, image, layer.is_residual, runs)
            _in_rows(lambda first, last, out, rows=rows: rows(first, last, bounds, out), height, answer)
            image = answer
        out = torch.zeros(2 * height, 2 * width, self.network.tail.out_channels // 4)
        _in_rows(partial(convolve_last, *_source(last, image, runs, bounds), runs), height, out.numpy())
        return out.permute(2, 0, 1)[None]


class Source(NamedTuple):
    """What a convolution multiplies and adds: an image, and weights, factors and bias for its numbers."""

    image: np.ndarray
    weights: np.ndarray
    factors: np.ndarray
    bias: np.ndarray


def _source(layer: PackedLayer, image: np.ndarray, runs: np.ndarray, bounds: np.ndarray) -> Source:
    """Make the source of a layer, from the runs of an fp32 image, whose values lie within bounds [h, 2]."""
    rows = len(runs) + 2
    words, factors, sums = layer.weights
    if words.dtype == np.float32:
        _in_rows(partial(fill_around, runs, layer.of_nothing, np.float32(0)), rows, image)
        return Source(image, words, factors, layer.bias)
    least = min(bounds[:, 0].min(), layer.of_nothing.min(), 0.0)
    scale = np.float32(max(bounds[:, 1].max(), layer.of_nothing.max(), least + _LEAST_SPAN) - least) / _STEPS
    zero = np.rint(-least / scale).astype(np.float32)
    rounded = np.empty(image.shape, np.uint8)
    _in_rows(partial(quantise, image, scale, zero, runs), len(runs), rounded)
    of_nothing = np.rint(layer.of_nothing / scale + zero).clip(0, _STEPS).astype(np.uint8)
    _in_rows(partial(fill_around, runs, of_nothing, np.uint8(zero)), rows, rounded)
    factors = factors * scale
    return Source(rounded, words, factors, layer.bias - factors * zero * sums)


def _in_rows(kernel: Callable[[int, int, np.ndarray], None], rows: int, out: np.ndarray) -> None:
    in_parallel(lambda first, last: kernel(first, last, out), rows)


def _image(height: int, width: int, channels: int) -> np.ndarray:
    """Allocate an image, not filled."""
    return np.empty((height + 2, width + 2 + SPARE, channels), np.float32)


def _parameters(layer: nn.Conv2d) -> tuple[Tensor, Tensor]:
    assert layer.bias is not None  # the networks' convolutions all have one
    return layer.weight.detach().float().cpu(), layer.bias.detach().float().cpu()


class NetworkKernels(ReferenceBackend):
    """Networks by kernels."""

    decoder = staticmethod(decoder)
    decoder_inputs = staticmethod(decoder_inputs)
    superres = staticmethod(superres)
