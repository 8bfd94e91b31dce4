"""What a training begins with: fresh weights, or those of an avatar of the same hand and configuration."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..avatars.file import load_avatar
from ..hand.model import HandModel
from ..nerf.avatar import Avatar, AvatarConfig, new_avatar
from ..records.errors import LiveHandError


@dataclass(frozen=True)
class Origin:
    """An avatar to fine-tune.

    Attributes:
        avatar: as loaded.
        sha256: of its file.
    """

    avatar: Avatar
    sha256: str

    def provenance(self) -> dict[str, Any]:
        """What the avatar trained from it says of it."""
        return {"name": self.avatar.name, "sha256": self.sha256, "provenance": self.avatar.provenance}


def load_origin(path: Path) -> Origin:
    """Read an avatar to fine-tune.

    Raises:
        LiveHandError: as `load_avatar`.
    """
    avatar = load_avatar(path)
    return Origin(avatar, hashlib.sha256(path.read_bytes()).hexdigest())


def first_avatar(name: str, hand: HandModel, config: AvatarConfig, seed: int, origin: Origin | None) -> Avatar:
    """The avatar before the first step.

    Raises:
        LiveHandError: the origin is of another hand or configuration.
    """
    avatar = new_avatar(name, hand.name, hand.sha256, config, seed)
    if origin is None:
        return avatar
    if origin.avatar.hand_sha256 != hand.sha256:
        raise LiveHandError(
            f"the avatar to start from must be of hand '{hand.name}', got '{origin.avatar.name}' of hand "
            f"'{origin.avatar.hand_name}'; give that hand with --hand, or start from another avatar"
        )
    if origin.avatar.config != config:
        raise LiveHandError(
            f"the avatar to start from must be of the configuration to train, got '{origin.avatar.name}' of another; "
            "choose its own with --config, or start from another avatar"
        )
    avatar.field.load_state_dict(origin.avatar.field.state_dict())
    avatar.superres.load_state_dict(origin.avatar.superres.state_dict())
    return avatar
