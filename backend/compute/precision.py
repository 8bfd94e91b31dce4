"""The precision in which networks run: fp32, or bf16 where the processor is not slower with it."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Literal

import torch
from torch import Tensor, nn

from ..field.field import PlaneField

Precision = Literal["fp32", "bf16"]

Decoder = Callable[[Tensor], Tensor]
"""The layers of a field's decoder: inputs [R, C] -> outputs [R, D], without gradients."""


@cache
def has_fast_bf16(device: torch.device) -> bool:
    """Return whether bf16 is no slower than fp32 on this device.

    Processors without AVX-512 (on Arm: without bf16 instructions) compute torch's bf16 number by number: networks take
    ten times as long.
    """
    is_supported = getattr(torch.ops.mkldnn, "_is_mkldnn_bf16_supported", lambda: False)
    return device.type != "cpu" or is_supported()


def autocast(device: torch.device, precision: Precision) -> torch.autocast:
    """Return the context in which networks run: bf16 is autocast where no slower than fp32; geometry never is."""
    return torch.autocast(device.type, torch.bfloat16, enabled=precision == "bf16" and has_fast_bf16(device))


def in_precision(network: nn.Module, device: torch.device, precision: Precision) -> Callable[[Tensor], Tensor]:
    """Wrap the network as a function that runs in its own autocast."""

    def run(values: Tensor) -> Tensor:
        with autocast(device, precision):
            return network(values)

    return run


def decoder_in_precision(field: PlaneField, device: torch.device, precision: Precision) -> Decoder:
    """Wrap the field's decoder as a function that runs in its own autocast."""

    def run(values: Tensor) -> Tensor:
        with autocast(device, precision):
            return field.decoded(values)

    return run
