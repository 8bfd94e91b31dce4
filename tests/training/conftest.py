"""What the tests of training share: a small configuration that trains in seconds."""

import json
from dataclasses import replace

import pytest
import torch
from livehand.backend.avatars.avatar import AvatarConfig, new_avatar
from livehand.backend.field.field import FieldConfig
from livehand.backend.field.sampler import SamplerConfig
from livehand.backend.image.superres import SuperResConfig
from livehand.backend.training.config import ReportConfig
from livehand.backend.training.processes import ComputeSetup
from livehand.backend.training.setup import TrainingSetup
from livehand.backend.training.views import TrainingViews


@pytest.fixture(scope="session")
def cpu():
    return torch.device("cpu")


@pytest.fixture(scope="session")
def compute(cpu):
    return ComputeSetup(cpu)


@pytest.fixture(scope="session")
def small():
    """An avatar configuration with few weights."""
    return AvatarConfig(
        FieldConfig(width=16, planes=((32, 2, 4),), relief=8), SuperResConfig(width=8, depth=2), SamplerConfig(4, 0.003)
    )


@pytest.fixture(scope="session")
def lit_config(small):
    return replace(
        small, field=replace(small.field, light="linear"), superres=SuperResConfig(kind="lit", width=8, depth=2)
    )


@pytest.fixture(scope="session")
def silent():
    """A report without previews that logs every step."""
    return ReportConfig(preview_minutes=0.0, log_every=1)


@pytest.fixture
def setup(painted_capture, hand, small):
    return TrainingSetup(painted_capture, hand, small)


@pytest.fixture
def avatar(hand, small):
    """An untrained avatar."""
    return new_avatar("a", hand.name, hand.sha256, small)


@pytest.fixture(scope="module")
def views(painted_capture, hand, small, cpu):
    return TrainingViews(painted_capture, painted_capture.of_split("train"), hand, small.sampler, cpu, 0)


@pytest.fixture(scope="session")
def log_of():
    """A function (avatar's path) -> the entries of its log."""

    def read(output):
        return [json.loads(line) for line in output.with_suffix(".log.jsonl").read_text().splitlines()]

    return read


@pytest.fixture(scope="session")
def weights_of():
    """A function (avatar) -> the weights of both networks by name."""

    def weights(avatar):
        parts = ("field", avatar.field), ("superres", avatar.superres)
        return {f"{name}.{key}": value for name, part in parts for key, value in part.state_dict().items()}

    return weights
