"""Which device is used."""

import pytest
import torch
from livehand.backend.records.errors import LiveHandError
from livehand.backend.rendering.device import torch_device


def test_a_missing_gpu_is_told():
    if torch.cuda.is_available():
        assert torch_device("auto") == torch_device("cuda") == torch.device("cuda")
    else:
        assert torch_device("auto") == torch.device("cpu")
        with pytest.raises(LiveHandError, match="needs a CUDA GPU"):
            torch_device("cuda")
