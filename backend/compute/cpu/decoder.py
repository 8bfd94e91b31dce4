"""The decoder of a field of planes by the kernels, where the processor has the vectors."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn

from ...field.field import MIN_ALPHA, PlaneField
from ...field.relightable import LitField
from ...field.volume import Composite
from ...light.lighting import Openness
from ..backend import Decoder, Precision, decoder_in_precision
from ..kernels.decoder import GROUP, decode_rays
from ..kernels.decoder import decoder_inputs as fill_inputs
from ..kernels.vectors import has_int8_products, has_vectors
from .arrays import as_arrays
from .packing import PackedWeights
from .threads import in_parallel, on_all_threads

Layer = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Weights, factors and bias as `decode_rays` takes them."""


def decoder(field: PlaneField, device: torch.device, precision: Precision) -> Decoder:
    """A field's decoder by the kernels; in reduced precision its second layer, the widest, multiplies int8."""
    if not has_vectors():
        return on_all_threads(decoder_in_precision(field, device, precision))
    is_int8 = precision == "bf16" and has_int8_products()
    layers: list[Layer] = []
    for layer in (*field.trunk, field.channels):
        assert isinstance(layer, nn.Linear)
        inputs = layer.in_features if not layers else len(layers[-1][2])
        layers.append(_packed(layer, inputs, is_int8 and len(layers) == 1))
    steps = np.full(1, 255, np.uint8) if is_int8 else np.empty(0, np.float32)
    return partial(_decode, layers, steps, field.channels.out_features)


def decoder_inputs(
    field: LitField, gathered: Composite, view: Float[Tensor, "R 3"], open_to: Openness
) -> Float[Tensor, "R C"]:
    """As `LitField.decoder_inputs`."""
    count, near = len(view), field.near_channels
    inputs = torch.empty(count, near + field.ANGLES)
    rays, out = as_arrays(gathered.channels, gathered.alpha, view, *open_to), inputs.numpy()
    known = *rays, near, field.normal_slice.start, np.float32(MIN_ALPHA)
    in_parallel(lambda first, last: fill_inputs(*known, first, last, out), count)
    return inputs


def _decode(layers: Sequence[Layer], steps: np.ndarray, outputs: int, inputs: Float[Tensor, "R C"]) -> Tensor:
    """[R, outputs]."""
    source, decoded = inputs.float().contiguous().numpy(), torch.empty(len(inputs), outputs)
    out = decoded.numpy()
    in_parallel(lambda first, last: decode_rays(source, *layers, steps, first, last, out), len(out))
    return decoded


def _packed(layer: nn.Linear, inputs: int, is_int8: bool) -> Layer:
    """The layer with inputs padded to so many, and outputs to whole groups."""
    outputs = -(-layer.out_features // GROUP) * GROUP
    weight, bias = torch.zeros(outputs, inputs), torch.zeros(outputs)
    weight[: layer.out_features, : layer.in_features] = layer.weight.detach()
    bias[: layer.out_features] = layer.bias.detach()
    groups = [PackedWeights.of(rows[:, :, None, None], is_int8) for rows in weight.split(GROUP)]
    words, factors, _ = (np.stack(values) for values in zip(*groups, strict=True))
    return words, factors.ravel(), bias.numpy()
