"""What a training starts from, fresh or fine-tuned, and the identity of a run."""

import json
from dataclasses import replace

import pytest
import torch
from livehand.backend.avatars.avatar import new_avatar
from livehand.backend.avatars.file import load_avatar, save_avatar
from livehand.backend.image.superres import SuperResConfig
from livehand.backend.records.errors import LiveHandError
from livehand.backend.training.config import LossConfig, TrainConfig
from livehand.backend.training.loop import train
from livehand.backend.training.setup import initial_avatar, load_base_avatar, run_identity


@pytest.fixture
def base_path(hand, small, tmp_path):
    """The file of an avatar with weights that no seed in these tests gives."""
    avatar = new_avatar("first", hand.name, hand.sha256, small, seed=77)
    save_avatar(replace(avatar, provenance={"licence": "CC0"}), tmp_path / "first.safetensors")
    return tmp_path / "first.safetensors"


@pytest.fixture
def fine_tuning(setup, base_path):
    return replace(setup, base=load_base_avatar(base_path))


def test_training_begins_with_the_weights_of_the_avatar(fine_tuning, base_path, compute, silent, tmp_path, weights_of):
    avatar, expected = initial_avatar("a", fine_tuning, 0), weights_of(load_avatar(base_path))
    for key, value in weights_of(avatar).items():
        assert torch.equal(value, expected[key])
    assert avatar.name == "a"
    frozen = TrainConfig(steps=1, learning_rate=0.0, plane_learning_rate=0.0)
    result = train(fine_tuning, frozen, tmp_path / "b.safetensors", compute, silent)
    for key, value in weights_of(result.avatar).items():
        torch.testing.assert_close(value, expected[key], atol=1e-7, rtol=0)
    base = load_avatar(tmp_path / "b.safetensors").provenance["fine_tuned_from"]
    assert base == {"name": "first", "sha256": fine_tuning.base.sha256, "provenance": {"licence": "CC0"}}


def test_avatars_of_other_hands_and_networks_are_refused(fine_tuning, hand, small):
    with pytest.raises(LiveHandError, match=f"must be of hand '{hand.name}', got 'first' of hand"):
        initial_avatar("a", replace(fine_tuning, hand=replace(hand, sha256="0" * 64)), 0)
    other = replace(small, superres=SuperResConfig(width=4, depth=2))
    with pytest.raises(LiveHandError, match="must be of the configuration to train, got 'first' of another"):
        initial_avatar("a", replace(fine_tuning, avatar_config=other), 0)


def test_a_checkpoint_of_another_base_avatar_is_refused(setup, fine_tuning, compute, silent, tmp_path):
    output, config = tmp_path / "b.safetensors", TrainConfig(steps=2, checkpoint_every=1)
    train(setup, config, output, compute, silent)
    with pytest.raises(LiveHandError, match="must be of the same capture and settings"):
        train(fine_tuning, config, output, compute, silent, resume=True)


def test_the_identity_is_that_of_earlier_checkpoints(setup):
    """The order of the settings counts."""
    identity = json.loads(run_identity(setup, TrainConfig(), "fp32", 6))
    settings, _, capture, view_count, precision, corrections, base = identity
    names = (
        "steps minutes batch seed learning_rate plane_learning_rate final_learning_rate decay warmup_steps "
        "warmup_share ema_decay max_skipped jitter_sets checkpoint_every checkpoint_minutes licence loss"
    )
    assert list(settings) == names.split()
    assert settings["loss"]["perceptual_region"] == "crop"
    assert (capture, view_count, precision, corrections, base) == ({"made_by": "test"}, 6, "fp32", {}, None)
    patch = run_identity(setup, TrainConfig(loss=LossConfig(perceptual_region="patch")), "fp32", 6)
    assert json.loads(patch)[0]["loss"]["perceptual_region"] == "patch"
