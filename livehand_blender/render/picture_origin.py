"""The origin of a rendered picture: a watermark in its hands, if scene or avatar ask for one, and its metadata."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import bpy
import numpy as np

from ...backend.avatars.metadata import licence_and_consent
from ...backend.avatars.origin import frame_payload, read_origin
from ...backend.render.frame_task import HandInstance
from ...backend.render.picture import Picture
from ...backend.render.session import Session


def read_payload(scene: bpy.types.Scene, hands: Sequence[HandInstance], session: Session) -> bytes | None:
    """Return the watermark of a frame with these hands; None: neither the scene nor an avatar asks for one.

    Raises:
        LiveHandError: the file of a hand is no avatar.
    """
    shown = [hand for hand in hands if not hand.is_holdout]
    origins = [read_origin(session.avatar_path(hand.renderer)) for hand in shown]
    return frame_payload(origins, scene.livehand.watermark)


def with_watermark(picture: Picture, payload: bytes | None) -> Picture:
    """Write the payload into the picture that is shown; its passes stay."""
    if payload is None:
        return picture
    from ...backend.image.watermark.embedding import watermarked

    covered = np.asarray(picture.visible_alpha, np.float32)
    combined = replace(picture.combined, rgb=watermarked(picture.combined.rgb, covered, payload))
    return replace(picture, combined=combined)


def metadata_fields(hands: Sequence[HandInstance]) -> dict[str, str]:
    """List the entries of a picture's metadata: avatars, their licences, and what their people agreed to."""
    avatars = {hand.renderer.avatar.name: hand.renderer.avatar for hand in hands if not hand.is_holdout}
    stated = [licence_and_consent(avatar.provenance) for avatar in avatars.values()]
    fields = {
        "LiveHand/Avatar": avatars,
        "LiveHand/License": [licence for licence, _ in stated if licence],
        "LiveHand/Consent": [consent for _, consent in stated if consent],
    }
    return {key: "; ".join(values) for key, values in fields.items() if values}
