"""Precision: bf16 where the machine has it."""

import pytest
import torch
from livehand.backend.compute.precision import autocast, has_fast_bf16

CPU = torch.device("cpu")


@pytest.fixture
def with_bf16(monkeypatch):
    """A function (is_supported): let this processor have bf16 or not."""

    def give(is_supported):
        has_fast_bf16.cache_clear()
        monkeypatch.setattr(torch.ops.mkldnn, "_is_mkldnn_bf16_supported", lambda: is_supported)

    yield give
    has_fast_bf16.cache_clear()


@pytest.mark.parametrize("is_supported", [False, True])
def test_bf16_is_taken_where_it_is_not_emulated(with_bf16, is_supported):
    with_bf16(is_supported)
    layer, values = torch.nn.Linear(4, 4), torch.ones(1, 4)
    with autocast(CPU, "bf16"):
        assert layer(values).dtype == (torch.bfloat16 if is_supported else torch.float32)
    with autocast(CPU, "fp32"):
        assert layer(values).dtype == torch.float32


def test_other_devices_are_not_asked(with_bf16):
    with_bf16(False)
    assert has_fast_bf16(torch.device("cuda"))


def test_a_torch_that_cannot_tell_has_none(monkeypatch):
    has_fast_bf16.cache_clear()
    monkeypatch.setattr(torch.ops, "mkldnn", object())
    assert not has_fast_bf16(CPU)
    has_fast_bf16.cache_clear()
