"""What the tests of the baselines share."""

import pytest
import torch
from livehand.backend.research.baselines.method import Budget, FittingMachine
from livehand.backend.training.processes import ComputeSetup


@pytest.fixture(scope="session")
def cpu():
    return torch.device("cpu")


@pytest.fixture(scope="session")
def machine(cpu):
    return FittingMachine(ComputeSetup(cpu))


@pytest.fixture(scope="session")
def two_steps():
    return Budget(steps=2)


@pytest.fixture(scope="session")
def parameters():
    return lambda network: sum(parameter.numel() for parameter in network.parameters())
