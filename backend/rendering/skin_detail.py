"""Whose skin an avatar shows: the fine detail of people whom `livehand capture` made is known (`hand.skin_detail`)."""

from __future__ import annotations

import math
from typing import Any

import torch

from ..hand.skin_detail import SkinBend, load_skin_detail
from ..nerf.avatar import Avatar
from ..nerf.skin_detail import DetailMaps, SkinLook


def detail_of(avatar: Avatar, device: torch.device) -> tuple[DetailMaps, SkinBend] | None:
    """The detail of the skin that the avatar was trained on; None: its capture showed another than the built-in one."""
    return detail_of_capture(avatar.provenance.get("capture"), avatar.hand_sha256, device)


def detail_of_capture(provenance: Any, hand_sha256: str, device: torch.device) -> tuple[DetailMaps, SkinBend] | None:
    """The same, by a capture's provenance and hand."""
    person = _person(provenance)
    detail = None if person is None else load_skin_detail(hand_sha256)
    if person is None or detail is None:
        return None
    return DetailMaps.of(detail, person, device), detail.bend


def _person(capture: Any) -> SkinLook | None:
    """The person in a capture of the built-in skin, by its provenance."""
    if not isinstance(capture, dict) or capture.get("made_by") != "livehand capture" or "look_sha256" in capture:
        return None
    plan = capture.get("plan")
    person = plan.get("person") if isinstance(plan, dict) else None
    if not isinstance(person, dict) or person.get("nail_polish") is not None:
        return None
    numbers = [person.get(name) for name in SkinLook._fields]
    known = [float(value) for value in numbers if isinstance(value, int | float) and math.isfinite(value)]
    return SkinLook(*known) if len(known) == len(numbers) else None
