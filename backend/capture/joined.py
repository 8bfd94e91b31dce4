"""Captures of several people as one, on which one network with a code for each person is trained."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ..records.errors import LiveHandError
from .capture import Capture


def first_person(capture: Capture) -> Capture:
    """Select the views of the first person of a joined capture; of another, all."""
    if not capture.identities:
        return capture
    return replace(capture, views=tuple(view for view in capture.views if capture.identities[view.pose_index] == 0))


def joined(captures: Sequence[Capture]) -> Capture:
    """Join captures of one hand model, each of another person; the first is the first identity.

    Poses and cameras are numbered on, images keep their places, and a given surface is left out.

    Raises:
        LiveHandError: they are of different hand models, or have lights.
    """
    first, *others = captures
    different = [other for other in others if other.hand_sha256 != first.hand_sha256]
    if different:
        raise LiveHandError(
            f"captures of several people must be of one hand model, got another in {different[0].folder}; "
            "capture them on the same"
        )
    lit = [capture for capture in captures if capture.is_lit]
    if lit:
        raise LiveHandError(
            f"people who share a network have their capture's light in their colours, got lights in {lit[0].folder}; "
            "give captures without"
        )
    poses, views, identities = [], [], []
    cameras = 0
    for identity, capture in enumerate(captures):
        folder, start = capture.folder.resolve(), len(poses)
        for view in capture.views:
            mask = None if view.mask is None else str(folder / view.mask)
            numbers = {"camera_index": cameras + view.camera_index, "pose_index": start + view.pose_index}
            views.append(replace(view, file=str(folder / view.file), mask=mask, **numbers))
        cameras += 1 + max((view.camera_index for view in capture.views), default=-1)
        poses += capture.poses
        identities += [identity] * len(capture.poses)
    provenance = {"joined": [capture.provenance for capture in captures]}
    return Capture(
        first.folder, first.hand_sha256, provenance, tuple(poses), tuple(views), identities=tuple(identities)
    )
