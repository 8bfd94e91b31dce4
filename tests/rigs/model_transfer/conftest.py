"""What tests of transfers share: a model of MANO's format that is ours, laid upon once."""

import pytest
from livehand.backend.rigs.model_transfer.model_transfer import ModelTransfer
from livehand.tests.mano_twin import write_twin


@pytest.fixture(scope="session")
def twin(tmp_path_factory):
    return write_twin(tmp_path_factory.mktemp("twin") / "mano_twin.npz")


@pytest.fixture(scope="session")
def transfer(hand, twin):
    return ModelTransfer.of(hand, twin.model)
