"""The surface that a capture shows, by its file; or, of captures and avatars of before, by their provenance."""

from __future__ import annotations

from typing import Any

from ..capture.capture import Capture
from ..capture.person import person_of
from ..records.errors import LiveHandError
from ..surface.base_surface import surface_of_person
from ..surface.stored_surface import StoredSurface
from ..surface.surface_file import read_surface

_NUMBERS = {"melanin", "folds", "veins_mm"}
"""That a surface was shaped by before avatars held it."""


def surface_of_capture(capture: Capture) -> StoredSurface | None:
    """Read the surface that a capture shows; None: it names none.

    Raises:
        LiveHandError: its file is missing, broken, or of another hand.
    """
    if capture.surface is None:
        return surface_of_provenance(capture.provenance, capture.hand_sha256)
    path = capture.folder / capture.surface.file
    surface = read_surface(path, capture.surface.sha256)
    if surface.hand_sha256 != capture.hand_sha256:
        raise LiveHandError(
            f"{path} must lie on the capture's hand {capture.hand_sha256[:12]}..., got one of hand "
            f"{surface.hand_sha256[:12]}...; remove `surface` from transforms.json, or give that hand's"
        )
    return surface


def surface_of_provenance(capture: Any, hand_sha256: str) -> StoredSurface | None:
    """Make the surface of a person whom `livehand capture` made before captures held surfaces; None: it names none.

    Args:
        capture: its provenance.
        hand_sha256: identity of its hand model.
    """
    if not isinstance(capture, dict) or capture.get("made_by") != "livehand capture" or "look_sha256" in capture:
        return None
    plan = capture.get("plan")
    reported = plan.get("person") if isinstance(plan, dict) else None
    if not isinstance(reported, dict) or not reported.keys() >= _NUMBERS:
        return None
    try:
        person = person_of(reported, "provenance")
    except LiveHandError:
        return None
    return surface_of_person(person, hand_sha256)
