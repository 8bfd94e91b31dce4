"""The properties of a hand that choose its look, the files of its model and avatar, and the loading of its renderer.

A hand without a model file is the built-in hand.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import bpy

from ...backend.avatars.library import PERSONS, SKINS, shipped_avatar_path, shipped_skin
from ...backend.hand.model import HandModel
from ...backend.hand.model_file import builtin_hand_path
from ...backend.image.grade import Grade
from ...backend.records.errors import LiveHandError
from ...backend.render.frame_task import HandRenderer
from ...backend.render.session import Device, Session, load_renderer
from .package_folder import missing_packages


@dataclass(frozen=True)
class HandSource:
    """The files of a hand's model and avatar.

    Attributes:
        model_path: of the hand model.
        avatar_path: of the avatar.
        builtin_sha256: the hash that the built-in hand must have, as the hand names no file of its own; else None.
    """

    model_path: Path
    avatar_path: Path
    builtin_sha256: str | None = None

    def renderer(self, session: Session, device: Device) -> HandRenderer:
        """Return the hand's renderer; loading it may take seconds.

        Raises:
            LiveHandError: a file or a package is missing, or they do not fit together.
        """
        model = session.hand(self.model_path)
        if self.builtin_sha256 is not None and self.builtin_sha256 != model.sha256:
            raise LiveHandError(
                f"a hand of another model than the built-in one must name the model's file, got none and the hash "
                f"{self.builtin_sha256[:12]}...; choose that file in Hand Model, or add the hand again"
            )
        return session.renderer(self.avatar_path, model, device)


def load_for(name: str, source: HandSource, session: Session, device: Device) -> HandRenderer:
    """Load the renderer of the hand of this name, with which an error begins; raises as `HandSource.renderer`."""
    try:
        return source.renderer(session, device)
    except LiveHandError as error:
        raise LiveHandError(f"'{name}' cannot be rendered: {error}") from error


def hand_source(armature: bpy.types.Object) -> HandSource:
    """Read the files that a hand names, with Blender's `//` resolved against the .blend that owns the hand."""
    owner, hand = armature.original, armature.original.livehand
    model_path, avatar_path = (
        Path(bpy.path.abspath(path, library=owner.library)) if path else None
        for path in (hand.model_path, hand.avatar_path)
    )
    return HandSource(
        model_path or builtin_hand_path(),
        avatar_path or shipped_avatar_path(hand.skin),
        (hand.model_sha256 or None) if model_path is None else None,
    )


def drawing_note(avatar_paths: Iterable[Path]) -> str:
    """Tell which people of numbers alone are loaded, which takes long at first; empty: none of these avatars."""
    skins = {shipped_skin(path) for path in avatar_paths}
    drawn = [person for skin, person in PERSONS.items() if skin in skins and skin not in SKINS]
    return f"loading {', '.join(drawn)}: at first use, the skin is drawn in some 20 seconds" if drawn else ""


def set_avatar(armature: bpy.types.Object, path: Path) -> None:
    """Let a hand use an avatar's file, or the skin that it has if the file is one that ships."""
    skin = shipped_skin(path)
    if skin is not None:
        armature.livehand.skin = skin
    armature.livehand.avatar_path = "" if skin is not None else str(path.resolve())


def read_device(scene: bpy.types.Scene) -> Device:
    """Read the scene's device and precision, and whether it adds the skin's detail."""
    settings = scene.livehand
    return Device(settings.device, settings.precision, settings.skin_detail)


def read_grade(armature: bpy.types.Object) -> Grade:
    """Read the *Match Plate* settings of an evaluated armature, which holds the animated values of its frame."""
    hand = armature.livehand
    return Grade(hand.exposure, tuple(hand.gain), tuple(hand.bias))


def load_renderer_in_blender(avatar_path: Path, hand: HandModel, device: Device) -> HandRenderer:
    """Load the backend's renderer of one avatar.

    Raises:
        LiveHandError: a package is missing, or the avatar cannot be read or belongs to another hand model.
    """
    try:
        return load_renderer(avatar_path, hand, device)
    except ImportError as error:
        raise LiveHandError(missing_packages(error)) from error
