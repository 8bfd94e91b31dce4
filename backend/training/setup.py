"""The inputs and outputs of a training, and what its files record of them.

Both templates must lie over each other, as two versions of a hand do. What the new surface has beside the old one gets
the features of the old one's nearest point.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from scipy.spatial import KDTree
from torch import Tensor, nn

from ..avatars.avatar import Avatar, AvatarConfig, new_avatar
from ..avatars.captured_surface import surface_of_capture
from ..avatars.file import load_avatar
from ..capture.capture import Capture
from ..compute.precision import Precision
from ..field.encoding import FeaturePlane
from ..field.field import PlaneField
from ..hand.model import HandModel
from ..records.errors import LiveHandError
from ..records.light import Sky
from .checkpoint import Progress
from .config import TrainConfig
from .losses import PerceptualDistance
from .parts import Correction

_SAMPLES = 1_000_000
_FARTHEST_MEDIAN_M = 0.003


def transfer_planes(ours: PlaneField, hand: HandModel, theirs: PlaneField, their_hand: HandModel) -> None:
    """Fill the planes of `ours`, relief included, with those of `theirs`.

    Raises:
        LiveHandError: the templates do not lie over each other, or the planes differ.
    """
    own, others = (*ours.feature_planes, ours.relief), (*theirs.feature_planes, theirs.relief)
    if [(plane.heights, plane.channels) for plane in own] != [(plane.heights, plane.channels) for plane in others]:
        raise LiveHandError("planes can be carried over between equal configurations only; choose the same --config")
    rng = np.random.default_rng(0)
    place, uv = _samples(hand, rng)
    their_place, their_uv = _samples(their_hand, rng)
    distance, nearest = KDTree(their_place).query(place)
    if np.median(distance) > _FARTHEST_MEDIAN_M:
        raise LiveHandError(
            f"the hand of the avatar to start from must lie over '{hand.name}', got one whose surface is "
            f"{1000 * np.median(distance):.0f} mm away; start without --from"
        )
    to, at = (torch.as_tensor(value, dtype=torch.float32) for value in (uv, their_uv[nearest]))
    with torch.no_grad():
        for plane, source in zip(own, others, strict=True):
            _fill(plane, source, to, at)


def _samples(hand: HandModel, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Draw random points [N, 3] m of the template's surface, uniform by area, and their atlas coordinates [N, 2]."""
    corners = hand.v_template[hand.f]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    face = rng.choice(len(area), _SAMPLES, p=area / area.sum())
    weights = rng.dirichlet((1, 1, 1), _SAMPLES)
    place = np.einsum("nk,nkc->nc", weights, corners[face])
    return place, np.einsum("nk,nkc->nc", weights, hand.vt[hand.ft[face]])


def _fill(plane: FeaturePlane, source: FeaturePlane, to: Tensor, at: Tensor) -> None:
    """Fill each texel with the mean over its samples; those without any, between the charts, with the nearest's."""
    size = plane.resolution
    column, row = (to * size).long().clamp(0, size - 1).unbind(-1)
    texel = row * size + column
    count = torch.zeros(size * size).index_add(0, texel, torch.ones(len(texel)))
    is_filled = (count > 0).numpy()
    grid = np.stack(np.divmod(np.arange(size * size), size), -1)
    nearest = torch.as_tensor(np.flatnonzero(is_filled)[KDTree(grid[is_filled]).query(grid)[1]])
    table = plane.table.view(size * size, plane.heights, plane.channels)
    for layer in range(plane.heights):
        height = torch.full((len(at),), -1.0 + 2.0 * layer / max(plane.heights - 1, 1))
        values = source(at, height, torch.ones(len(at)))
        mean = torch.zeros(size * size, plane.channels).index_add(0, texel, values) / count.clamp(min=1)[:, None]
        table[:, layer] = mean[nearest]


@dataclass(frozen=True)
class BaseAvatar:
    """An avatar to fine-tune.

    Attributes:
        avatar: as loaded.
        sha256: of its file.
        hand: its hand model, if that is not the capture's.
    """

    avatar: Avatar
    sha256: str
    hand: HandModel | None = None


@dataclass(frozen=True)
class TrainingSetup:
    """What is trained on what.

    Attributes:
        capture: images and poses of the hand.
        hand: the hand model of the capture's poses.
        avatar_config: the networks.
        perceptual: the perceptual distance; None leaves that term out.
        corrections: of the capture, trained with the networks.
        base: the avatar to fine-tune; None starts from random weights.
        is_code_alone: whether the networks of `base` stay, and only its people's codes learn.
    """

    capture: Capture
    hand: HandModel
    avatar_config: AvatarConfig
    perceptual: PerceptualDistance | None = None
    corrections: tuple[Correction, ...] = ()
    base: BaseAvatar | None = None
    is_code_alone: bool = False


class TrainingResult(NamedTuple):
    """A finished training.

    Attributes:
        avatar: has the averaged weights.
        progress: steps and time of all sessions.
        data_wait_share: share of this session's time that was spent waiting for images.
        held_out: metrics of the last preview, dB; empty if there was none.
    """

    avatar: Avatar
    progress: Progress
    data_wait_share: float
    held_out: dict[str, float]


def load_base_avatar(path: Path, hand: HandModel | None = None) -> BaseAvatar:
    """Read an avatar to fine-tune, of its own hand model if that is not the capture's.

    Raises:
        LiveHandError: as `load_avatar`, or the avatar is not of that hand.
    """
    avatar = load_avatar(path)
    if hand is not None and hand.sha256 != avatar.hand_sha256:
        raise LiveHandError(
            f"the avatar to start from must be of hand '{hand.name}', got '{avatar.name}' of '{avatar.hand_name}'; "
            "give its own hand with --from-hand"
        )
    return BaseAvatar(avatar, hashlib.sha256(path.read_bytes()).hexdigest(), hand)


def initial_avatar(name: str, setup: TrainingSetup, seed: int) -> Avatar:
    """Make the avatar before the first step.

    Raises:
        LiveHandError: the avatar to fine-tune has another hand or configuration, or the capture's surface is broken.
    """
    hand, config = setup.hand, setup.avatar_config
    given = {"sky": sky_of(setup.capture), "surface": surface_of_capture(setup.capture)}
    avatar = replace(new_avatar(name, hand.name, hand.sha256, config, seed), **given)
    if setup.base is None:
        return avatar
    base = setup.base.avatar
    their_hand = setup.base.hand
    if base.hand_sha256 != hand.sha256 and their_hand is None:
        raise LiveHandError(
            f"the avatar to start from must be of hand '{hand.name}', got '{base.name}' of hand '{base.hand_name}'; "
            "give that hand with --hand, or as --from-hand if its surface lies over this one's"
        )
    if base.config != config and _relightable(base.config) != _relightable(config):
        raise LiveHandError(
            f"the avatar to start from must be of the configuration to train, got '{base.name}' of another; choose its "
            "own with --config, or start from another avatar"
        )
    for ours, theirs in ((avatar.field, base.field), (avatar.superres, base.superres)):
        load_what_fits(ours, theirs)
    if their_hand is not None and isinstance(avatar.field, PlaneField) and isinstance(base.field, PlaneField):
        transfer_planes(avatar.field, hand, base.field, their_hand)
    return avatar


def _relightable(config: AvatarConfig) -> AvatarConfig:
    """Add light to the configuration; an avatar with baked light and a relightable one share geometry and planes."""
    field, superres = replace(config.field, light="linear"), replace(config.superres, kind="lit")
    return replace(config, field=field, superres=superres)


def load_what_fits(ours: nn.Module, theirs: nn.Module) -> None:
    """Copy all weights, or, between a relightable network and a baked one, those that they share."""
    own, weights = ours.state_dict(), theirs.state_dict()
    ours.load_state_dict({**own, **{k: v for k, v in weights.items() if k in own and own[k].shape == v.shape}})


def sky_of(capture: Capture) -> Sky | None:
    """Return the sky of the capture: that of its dome, or else the mean of its skies; None: it has none."""
    skies = [(light.kind, light.light.sky) for light in capture.lights if light.light.sky is not None]
    shapes = {sky.radiance.shape for _, sky in skies}
    domes = [sky for kind, sky in skies if kind == "dome"]
    if domes or len(shapes) != 1:
        return next(iter(domes), None)
    return Sky(np.mean([sky.radiance for _, sky in skies], 0))


def run_identity(setup: TrainingSetup, config: TrainConfig, precision: Precision, view_count: int) -> str:
    """Return all that determines the result; a checkpoint is resumed only by a run with the same identity."""
    corrections = {correction.name: [correction.learning_rate, correction.settings] for correction in setup.corrections}
    base, capture = setup.base.sha256 if setup.base else None, setup.capture.provenance
    if setup.capture.surface is not None:
        capture = {**capture, "surface_sha256": setup.capture.surface.sha256}
    settings = asdict(config), asdict(setup.avatar_config)
    trained = ["code"] if setup.is_code_alone else []
    return json.dumps([*settings, capture, view_count, precision, corrections, base, *trained])


def provenance_of(
    setup: TrainingSetup, config: TrainConfig, precision: Precision, progress: Progress
) -> dict[str, Any]:
    """Make the record of the training for the avatar's header."""
    provenance = {
        "made_by": "livehand train",
        "training": asdict(config),
        "steps_taken": progress.step,
        "steps_skipped": progress.skipped,
        "precision": precision,
        "capture": setup.capture.provenance,
        "licence": config.licence,
    }
    if setup.corrections:
        provenance["corrections"] = {correction.name: correction.settings for correction in setup.corrections}
    if setup.base:
        base = setup.base.avatar
        provenance["fine_tuned_from"] = {
            "name": base.name,
            "sha256": setup.base.sha256,
            "provenance": base.provenance,
        }
    return provenance
