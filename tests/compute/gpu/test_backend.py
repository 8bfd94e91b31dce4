"""What is checked before Warp is used on a GPU, and what is said where it cannot be."""

import logging
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
import torch
import warp as wp
from livehand.backend.avatars.file import load_avatar
from livehand.backend.compute.cpu.frames_on_gpu import FramesOnGpu
from livehand.backend.compute.gpu import backend as warp_module
from livehand.backend.compute.gpu.backend import WarpBackend
from livehand.backend.compute.gpu.lit_frame import LitFrame
from livehand.backend.compute.reference import ReferenceBackend
from livehand.backend.field.field import PaperField
from livehand.backend.records.errors import LiveHandError
from livehand.backend.render import backends
from livehand.backend.render import renderer as renderer_module
from livehand.backend.render.renderer import Renderer

from .whole_frames import assert_same_frame

CUDA = torch.device("cuda")


@pytest.fixture(autouse=True)
def search_again():
    """Warp is tried once per process."""
    backends._warp_works.cache_clear()
    yield
    backends._warp_works.cache_clear()


def test_known_values_are_computed(monkeypatch):
    warp_module.check_values("cpu")
    monkeypatch.setattr(wp, "launch", lambda *_, **__: None)
    with pytest.raises(LiveHandError, match="axes must be"):
        warp_module.check_values("cpu")


def test_a_missing_driver_is_named_once_and_torch_renders(monkeypatch, caplog):
    monkeypatch.setattr(wp, "is_cuda_available", lambda: False)
    monkeypatch.setattr(wp, "get_cuda_driver_version", lambda: (11, 8))
    with caplog.at_level(logging.WARNING):
        chosen = [backends.choose_backend(CUDA) for _ in range(3)]
    assert not any(isinstance(one, WarpBackend) for one in chosen)
    assert len(caplog.records) == 1
    assert "got one for CUDA 11.8; update the driver" in caplog.text
    assert "got none" in warp_module.driver_message((13, 4), None)


def test_a_chip_that_is_too_old_is_named(monkeypatch):
    monkeypatch.setattr(wp, "is_cuda_available", lambda: True)
    monkeypatch.setattr(wp, "get_cuda_device", lambda: type("Chip", (), {"arch": 61}))
    monkeypatch.setattr(wp, "get_cuda_supported_archs", lambda: [75, 90])
    with pytest.raises(LiveHandError, match=r"7\.5 or later, got 6\.1"):
        warp_module.check_gpu()


def test_warp_is_chosen_on_a_gpu_that_it_can_use_and_never_on_a_cpu(monkeypatch):
    monkeypatch.setattr(warp_module, "check_gpu", lambda: None)
    assert isinstance(backends.choose_backend(CUDA), WarpBackend)
    assert not isinstance(backends.choose_backend(torch.device("cpu")), WarpBackend)


@pytest.fixture
def on_gpu(monkeypatch, hand):
    """A renderer of `cuda` where Warp works and torch knows no GPU; the CPU stands for it."""
    monkeypatch.setattr(renderer_module, "gpu_renderer", lambda: FramesOnGpu("cpu"))
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    return Renderer(load_avatar(), hand, "cuda")


@pytest.mark.slow
def test_rendering_on_a_gpu_needs_no_torch_for_it(on_gpu, first):
    assert on_gpu.torch_device == torch.device("cpu")
    assert on_gpu.renders_at_once
    frame = on_gpu.render(first)
    with torch.inference_mode():
        assert np.array_equal(frame.rgb, on_gpu.pipeline.at_once(first).rgb)


def test_an_avatar_for_stages_is_torchs_where_torch_knows_the_gpu(on_gpu, monkeypatch):
    avatar = replace(on_gpu.avatar, field=PaperField())
    assert isinstance(Renderer(avatar, on_gpu.hand, "cuda")._on_gpu, FramesOnGpu)
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    assert Renderer(avatar, on_gpu.hand, "cuda").torch_device == CUDA
    assert Renderer(on_gpu.avatar, on_gpu.hand, "cuda", has_skin_detail=False).torch_device == CUDA
    assert Renderer(on_gpu.avatar, on_gpu.hand, "cuda").torch_device == torch.device("cpu")


def test_what_renders_on_a_gpu_is_there_if_warp_works(monkeypatch):
    monkeypatch.setattr(warp_module, "check_gpu", lambda: None)
    assert isinstance(backends.gpu_renderer(), FramesOnGpu)
    assert backends.gpu_renderer().device == "cuda:0"
    monkeypatch.setitem(sys.modules, "warp", None)
    assert backends.gpu_renderer() is None


def test_warp_is_used_as_soon_as_it_is_installed(monkeypatch):
    """By Install GPU Rendering, in a Blender that has rendered without it."""
    monkeypatch.setattr(warp_module, "check_gpu", lambda: None)
    with monkeypatch.context() as before:
        before.setitem(sys.modules, "warp", None)
        assert backends.gpu_renderer() is None
        assert not isinstance(backends.choose_backend(CUDA), WarpBackend)
    assert isinstance(backends.gpu_renderer(), FramesOnGpu)
    assert isinstance(backends.choose_backend(CUDA), WarpBackend)


@pytest.mark.slow
def test_a_gpu_that_fails_is_named_once_and_the_cpu_renders(on_gpu, theirs, first, monkeypatch, caplog):
    tried = []

    def broken(*_):
        tried.append(1)
        raise RuntimeError("CUDA error 700: an illegal memory access")

    monkeypatch.setattr(LitFrame, "render", broken)
    with caplog.at_level(logging.WARNING):
        frames = [on_gpu.render(first) for _ in range(2)]
    assert len(tried) == 1
    assert caplog.text.count("error 700") == 1
    theirs.forget()
    for frame in frames:
        assert_same_frame(frame, theirs.render(first))


def test_without_warp_nothing_is_said(monkeypatch, caplog):
    monkeypatch.setitem(sys.modules, "warp", None)
    assert isinstance(backends.choose_backend(CUDA), ReferenceBackend)
    assert not caplog.records


@pytest.mark.slow
def test_rendering_on_a_cpu_imports_no_warp():
    code = """
import sys
from livehand.backend.avatars.file import load_avatar
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.render.renderer import Renderer
from livehand.livehand_blender.cli import COMMANDS
Renderer(load_avatar(), load_default_hand()).pipeline
print("warp" in sys.modules)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False"]
