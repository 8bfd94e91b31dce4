"""Which device is used."""

import os
import subprocess
import sys

import pytest
import torch
from livehand.backend.records.errors import LiveHandError
from livehand.backend.render.device import rendering_device, torch_device


def test_a_missing_gpu_is_told():
    if torch.cuda.is_available():
        assert torch_device("auto") == torch_device("cuda") == torch.device("cuda")
    else:
        assert torch_device("auto") == torch.device("cpu")
        with pytest.raises(LiveHandError, match="needs a CUDA GPU"):
            torch_device("cuda")


def test_a_frame_is_the_kernels_even_beside_a_gpu(monkeypatch):
    """Which are faster than torch is there; training takes the GPU."""
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    assert rendering_device("auto") == torch.device("cpu")
    assert rendering_device("cuda") == torch_device("auto") == torch.device("cuda")
    monkeypatch.setattr("livehand.backend.render.device.has_numba", lambda: False)
    assert rendering_device("auto") == torch.device("cuda")


def test_the_gpu_of_a_mac_is_taken_on_request_only(monkeypatch):
    monkeypatch.setattr(torch.backends.mps, "is_available", lambda: True)
    assert torch_device("mps") == torch.device("mps")
    assert torch_device("auto").type != "mps"
    monkeypatch.setattr(torch.backends.mps, "is_available", lambda: False)
    with pytest.raises(LiveHandError, match="needs a Mac"):
        torch_device("mps")


@pytest.mark.slow
def test_every_command_lets_the_cpu_do_what_the_gpu_of_a_mac_cannot():
    """Read when torch is loaded, so it must be set before."""
    program = "import os; from livehand.livehand_blender.cli import main; main(['--help']); import sys; " + (
        "sys.exit('torch' in sys.modules or os.environ['PYTORCH_ENABLE_MPS_FALLBACK'] != '1')"
    )
    environment = {name: value for name, value in os.environ.items() if name != "PYTORCH_ENABLE_MPS_FALLBACK"}
    assert subprocess.run([sys.executable, "-c", program], env=environment, check=False).returncode == 0
