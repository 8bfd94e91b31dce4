"""Fine-tuning an avatar."""

from dataclasses import replace

import pytest
import torch
from livehand.backend.avatars.file import load_avatar, save_avatar
from livehand.backend.nerf.avatar import AvatarConfig, new_avatar
from livehand.backend.nerf.field import FieldConfig
from livehand.backend.nerf.sampler import SamplerConfig
from livehand.backend.nerf.superres import SuperResConfig
from livehand.backend.records.errors import LiveHandError
from livehand.backend.training.config import ReportConfig, TrainConfig
from livehand.backend.training.loop import train
from livehand.backend.training.origin import first_avatar, load_origin
from livehand.backend.training.setup import TrainingSetup
from livehand.backend.training.processes import ComputeSetup

SMALL = AvatarConfig(
    FieldConfig(width=16, planes=((32, 2, 4),), relief=8), SuperResConfig(width=8, depth=2), SamplerConfig(4, 0.003)
)
MACHINE, SILENT = ComputeSetup(torch.device("cpu")), ReportConfig(preview_minutes=0.0)


@pytest.fixture
def saved(hand, tmp_path):
    """An avatar's file, of weights that no seed here gives."""
    avatar = new_avatar("first", hand.name, hand.sha256, SMALL, seed=77)
    save_avatar(replace(avatar, provenance={"licence": "CC0"}), tmp_path / "first.safetensors")
    return tmp_path / "first.safetensors"


def test_training_begins_with_the_avatars_weights(hand, saved, painted_capture, tmp_path):
    avatar = first_avatar("a", hand, SMALL, 0, load_origin(saved))
    for part in ("field", "superres"):
        for key, value in getattr(load_avatar(saved), part).state_dict().items():
            assert torch.equal(value, getattr(avatar, part).state_dict()[key])
    assert avatar.name == "a"
    task = TrainingSetup(painted_capture, hand, SMALL, origin=load_origin(saved))
    still = TrainConfig(steps=1, learning_rate=0.0, plane_learning_rate=0.0)
    outcome = train(task, still, tmp_path / "b.safetensors", MACHINE, SILENT)
    for key, value in load_avatar(saved).field.state_dict().items():
        torch.testing.assert_close(outcome.avatar.field.state_dict()[key], value, atol=1e-7, rtol=0)
    origin = load_avatar(tmp_path / "b.safetensors").provenance["fine_tuned_from"]
    assert origin == {"name": "first", "sha256": load_origin(saved).sha256, "provenance": {"licence": "CC0"}}


def test_avatars_of_other_hands_and_networks_are_refused(hand, saved):
    origin = load_origin(saved)
    with pytest.raises(LiveHandError, match="must be of hand 'hand_default', got 'first' of hand"):
        first_avatar("a", replace(hand, sha256="0" * 64), SMALL, 0, origin)
    other = replace(SMALL, superres=SuperResConfig(width=4, depth=2))
    with pytest.raises(LiveHandError, match="must be of the configuration to train, got 'first' of another"):
        first_avatar("a", hand, other, 0, origin)


def test_a_checkpoint_of_another_origin_is_refused(hand, saved, painted_capture, tmp_path):
    task, config = TrainingSetup(painted_capture, hand, SMALL), TrainConfig(steps=2, checkpoint_every=1)
    train(task, config, tmp_path / "b.safetensors", MACHINE, SILENT)
    with pytest.raises(LiveHandError, match="must be of the same capture and settings"):
        train(replace(task, origin=load_origin(saved)), config, tmp_path / "b.safetensors", MACHINE, SILENT, True)
