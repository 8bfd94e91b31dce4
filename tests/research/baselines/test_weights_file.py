"""The file of a fitted method: what it is given comes back, and any other file is refused in words."""

import os

import pytest
import torch
from livehand.backend.records.errors import LiveHandError
from livehand.backend.research.baselines.weights_file import FILE, load_method, load_network, save_method
from safetensors.torch import save_file


def test_tensors_and_facts_come_back(tmp_path):
    save_method(tmp_path, "x", {"a": torch.arange(3.0)}, {"size": 3})
    tensors, facts = load_method(tmp_path, "x")
    assert torch.equal(tensors["a"], torch.arange(3.0))
    assert facts == {"kind": "x", "size": 3}


@pytest.mark.parametrize("facts", ["[]", '"x"', "5", "null", '{"kind": ["x"]}', "[" * 5000, "{"])
def test_facts_that_are_none(tmp_path, facts):
    save_file({"a": torch.zeros(1)}, tmp_path / FILE, metadata={"livehand_method": facts})
    with pytest.raises(LiveHandError, match=r"must hold a fitted x, got .*--redo"):
        load_method(tmp_path, "x")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs named pipes")
def test_a_pipe_is_refused_without_waiting(tmp_path):
    os.mkfifo(tmp_path / FILE)
    with pytest.raises(LiveHandError, match="pipe"):
        load_method(tmp_path, "x")


def test_weights_of_another_size(tmp_path):
    save_method(tmp_path, "x", torch.nn.Linear(2, 3).state_dict())
    with pytest.raises(LiveHandError, match="must fit this version's x"):
        load_network(tmp_path, "x", torch.nn.Linear(2, 2))
