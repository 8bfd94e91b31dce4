"""An avatar: the trained field and super-resolution of one hand."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import nn

from ..field.ablations import BonesField, XyzField
from ..field.field import BakedField, FieldConfig, MlpField, PaperField, PlaneField
from ..field.relightable import RelightableField
from ..field.sampler import SamplerConfig
from ..image.superres import SuperResConfig, build_superres
from ..records.light import Sky
from ..surface.stored_surface import StoredSurface


@dataclass(frozen=True)
class AvatarConfig:
    """The configuration of an avatar's networks and sampler."""

    field: FieldConfig = dataclasses.field(default_factory=FieldConfig)
    """The radiance field."""
    superres: SuperResConfig = dataclasses.field(default_factory=SuperResConfig)
    """The super-resolution network."""
    sampler: SamplerConfig = dataclasses.field(default_factory=SamplerConfig)
    """The samples along each ray."""


PRESETS: dict[str, AvatarConfig] = {
    "default": AvatarConfig(),
    "relightable": AvatarConfig(FieldConfig(light="linear"), SuperResConfig(kind="lit")),
    "poseless": AvatarConfig(FieldConfig(pose=False)),
    "paper": AvatarConfig(
        FieldConfig(kind="paper"), SuperResConfig(kind="paper"), SamplerConfig(samples_per_ray=16, shell_m=0.005)
    ),
}


@dataclass(frozen=True)
class Avatar:
    """A hand's appearance, ready to render.

    Attributes:
        name: for display.
        hand_name: name of the hand model it belongs to.
        hand_sha256: identity of that hand model.
        config: of its networks.
        field: the radiance field.
        superres: the super-resolution network.
        provenance: what it was trained on and how, and its licence.
        metrics: measured on held-out views.
        thumbnail: [P, P, 4] uint8 (`render.thumbnail`); None in files of earlier versions.
        sky: the light of its capture, in which a relightable avatar is rendered where none is given.
        surface: that its hand has, given and not learnt; None: the networks alone define its surface.
    """

    name: str
    hand_name: str
    hand_sha256: str
    config: AvatarConfig
    field: MlpField | PlaneField
    superres: nn.Module
    provenance: dict[str, Any] = dataclasses.field(default_factory=dict)
    metrics: dict[str, Any] = dataclasses.field(default_factory=dict)
    thumbnail: np.ndarray | None = None
    sky: Sky | None = None
    surface: StoredSurface | None = None


def build_field(config: FieldConfig) -> MlpField | PlaneField:
    """Build the field that the configuration names, with fresh weights."""
    if config.kind == "paper":
        return PaperField(config.pose, len(config.identities))
    kinds: dict[str, Callable[[bool], MlpField]] = {"xyz": XyzField, "bones": BonesField}
    if config.kind in kinds:
        return kinds[config.kind](config.pose)
    return RelightableField(config) if config.light == "linear" else BakedField(config)


def new_avatar(name: str, hand_name: str, hand_sha256: str, config: AvatarConfig, seed: int = 0) -> Avatar:
    """Make an untrained avatar with weights drawn from the seed."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        return Avatar(name, hand_name, hand_sha256, config, build_field(config.field), build_superres(config.superres))
