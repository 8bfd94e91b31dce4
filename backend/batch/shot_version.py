"""The version of a shot: all that decides how its frames look. The frames of one clip agree in it.

A resumed run compares the version that it would render with the one in the record beside each frame that stays.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

UNKNOWN = "unknown"
_KINDS = {
    "shot": "another state of the .blend",
    "linked": "other linked files",
    "avatars": "another avatar",
    "hand_models": "another hand model",
    "size_px": "another size",
    "livehand": "another version of LiveHand",
    "blender": "another version of Blender",
    "settings": "other settings",
    UNKNOWN: "unknown origin",
}


@dataclass(frozen=True)
class ShotVersion:
    """What the frames of a shot are made from.

    Attributes:
        livehand: its version.
        blender: its version.
        shot: sha256 of the .blend.
        linked: path and digest of every file that it reads; None: the file is missing.
        avatars: sha256 of the avatars of its hands.
        hand_models: sha256 of their hand models.
        size_px: (width, height) of the frames.
        settings: those that the command line can change.
    """

    livehand: str
    blender: str
    shot: str | None
    linked: Mapping[str, str | None]
    avatars: frozenset[str]
    hand_models: frozenset[str]
    size_px: tuple[int, int]
    settings: Mapping[str, str]

    def to_record(self) -> dict[str, Any]:
        """Return the version as a JSON object."""
        return {
            "livehand": self.livehand,
            "blender": self.blender,
            "shot": self.shot,
            "linked": dict(self.linked),
            "avatars": sorted(self.avatars),
            "hand_models": sorted(self.hand_models),
            "size_px": list(self.size_px),
            "settings": dict(self.settings),
        }

    def differences(self, record: Mapping[str, Any] | None) -> tuple[str, ...]:
        """List the keys in which a frame's record gives another version; `unknown` if it gives none."""
        version = record.get("version") if record else None
        if not isinstance(version, dict):
            return (UNKNOWN,)
        own, other = _comparable(self.to_record()), _comparable(version)
        return tuple(key for key in own if own[key] != other.get(key))

    def digest(self) -> str:
        """Hash the version: equal for equal versions, wherever their files lie."""
        return hashlib.sha256(json.dumps(_comparable(self.to_record()), sort_keys=True).encode()).hexdigest()


def _comparable(version: Mapping[str, Any]) -> dict[str, Any]:
    """Drop the paths of the files, which differ among a farm's machines, from the record of a version."""
    linked = version.get("linked")
    digests = sorted(map(str, linked.values())) if isinstance(linked, dict) else linked
    return {**version, "linked": digests}


def others_message(differences: Iterable[Iterable[str]]) -> str | None:
    """Describe the frames that stay, of which each differs in these keys; None if none does."""
    differing = [keys for keys in map(tuple, differences) if keys]
    if not differing:
        return None
    counts = {kind: sum(key in keys for keys in differing) for key, kind in _KINDS.items()}
    reported = [(count, kind) for kind, count in counts.items() if count]
    count = len(differing)
    text = f"{count} {'frame is' if count == 1 else 'frames are'} of "
    if len(reported) == 1:
        text += reported[0][1]
    else:
        text += f"another version ({', '.join(f'{count} of {kind}' for count, kind in reported)})"
    return f"{text}; --overwrite renders {'it' if count == 1 else 'them'} again, another folder keeps both"


def others_text(keys: Iterable[str]) -> str:
    """Describe what one frame is of, such as `of another avatar, of other settings`."""
    return ", ".join(f"of {_KINDS.get(key, key)}" for key in keys)
