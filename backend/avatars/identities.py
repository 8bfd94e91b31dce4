"""Several people in one avatar: one network, and a code for each of them.

A person's code acts on the first layer alone. So an avatar of one of them is the same network with that product in the
layer's bias, and renders wherever any avatar does.
"""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace

import torch
from torch import Tensor

from ..field.field import PaperField
from ..records.errors import LiveHandError
from .avatar import Avatar, build_field

MEAN = "mean"
"""The name that stands for the mean of all codes."""


def identity_names(avatar: Avatar) -> tuple[str, ...]:
    """List the names of an avatar's people; none: it shows one person."""
    return avatar.config.field.identities


def of_identity(avatar: Avatar, name: str) -> Avatar:
    """Return the avatar of one of its people, by name, or of the mean of all codes: `mean`.

    Raises:
        LiveHandError: nobody has the name.
    """
    names = identity_names(avatar)
    if not names:
        raise LiveHandError(f"'{avatar.name}' shows one person, so --identity must be left out, got {name}")
    if name != MEAN and name not in names:
        raise LiveHandError(f"--identity must be one of {', '.join(names)} or {MEAN}, got {name}")
    shared, codes = _networks(avatar)
    code = codes.mean(0) if name == MEAN else codes[names.index(name)]
    return replace(avatar, name=name, **_folded(avatar, shared, code))


def with_identity(avatar: Avatar, name: str) -> Avatar:
    """Add a person, whose code is the mean of all.

    Raises:
        LiveHandError: the avatar has one person without a code, or one of that name.
    """
    names = identity_names(avatar)
    if not names:
        raise LiveHandError(
            f"'{avatar.name}' must have people with codes of their own, got one without; train it on several captures"
        )
    checked_names((*names, name))
    shared, codes = _networks(avatar)
    config = replace(avatar.config, field=replace(avatar.config.field, identities=(*names, name)))
    grown = build_field(config.field)
    mean = codes.mean(0, keepdim=True)
    grown.load_state_dict({**shared.state_dict(), "codes": torch.cat([codes, mean])})
    return replace(avatar, config=config, field=grown, superres=deepcopy(avatar.superres))


def checked_names(names: tuple[str, ...]) -> tuple[str, ...]:
    """Return people's names.

    Raises:
        LiveHandError: one is empty, taken twice, or `mean`.
    """
    wrong = next((name for k, name in enumerate(names) if not name or name == MEAN or name in names[:k]), None)
    if wrong is not None:
        raise LiveHandError(f"people's names must differ, and none be empty or '{MEAN}', got '{wrong}'")
    return names


def _networks(avatar: Avatar) -> tuple[PaperField, Tensor]:
    field = avatar.field
    assert isinstance(field, PaperField), "a configuration with names is the paper's"
    assert field.codes is not None, "names and codes come together"
    return field, field.codes.detach()


def _folded(avatar: Avatar, shared: PaperField, code: Tensor) -> dict:
    config = replace(avatar.config, field=replace(avatar.config.field, identities=()))
    alone = build_field(config.field)
    assert shared.identity is not None, "codes have a layer"
    weights = {key: value for key, value in shared.state_dict().items() if key not in ("codes", "identity.weight")}
    with torch.no_grad():
        weights["position.bias"] = weights["position.bias"] + shared.identity(code)
    alone.load_state_dict(weights)
    return {"config": config, "field": alone}
