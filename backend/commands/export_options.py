"""Which options of `livehand export` are of which source and output: one that would not be heeded is refused."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from typing import NamedTuple

from ..records.errors import LiveHandError

RIG, SPLATS = "--rig", "splats"
BLEND, POSES, RIG_FILE = "a .blend", "a file of poses", "a rig's file"
"""The kinds of sources."""
_MESHES = ("fbx", "gltf", "usd")


class _Owner(NamedTuple):
    """The outputs that heed an option, and what they have to do with it."""

    outputs: tuple[str, ...]
    why: str


_SOURCES: Mapping[str, tuple[str, ...]] = {
    "frames": (BLEND,),
    "fps": (POSES, RIG_FILE),
    "hand": (POSES, RIG_FILE),
    "mano": (POSES,),
}
_OWNERS: Mapping[str, _Owner] = {
    "from_mean": _Owner(("mano",), "whose angles may count from MANO's mean"),
    "avatar": _Owner((*_MESHES, SPLATS), "which show a skin"),
    "texture_size": _Owner(_MESHES, "whose skin has textures"),
    "splats": _Owner((SPLATS,), "which alone consist of them"),
    "views": _Owner((SPLATS,), "which are fitted to views"),
    "view_size": _Owner((SPLATS,), "which are fitted to views"),
    "bones": _Owner((RIG,), "which keys a character's bones"),
    "arm": _Owner((RIG,), "which keys a character's bones"),
}


def check_options(args: argparse.Namespace, output: str) -> None:
    """Refuse options that an output does not heed: a format's name, or `RIG`.

    Raises:
        LiveHandError: an option is given that is another output's, or needs one that is missing.
    """
    for name, owner in _OWNERS.items():
        if _is_given(args, name) and output not in owner.outputs:
            raise LiveHandError(
                f"{_spelt(name)} is of {_listed(owner.outputs)}, {owner.why}, got {output}; leave it out"
            )
    if output == RIG and args.format:
        raise LiveHandError(f"--format is of files for other programs, got {RIG}, which writes a .blend; leave it out")
    if _is_given(args, "texture_size") and not args.avatar:
        raise LiveHandError("--texture-size is of a skin, got none; name whose (--avatar), or leave it out")


def check_source(args: argparse.Namespace, source: str) -> None:
    """Refuse options that a kind of source does not heed.

    Raises:
        LiveHandError: such an option is given. MANO's file is also of an output that counts from its mean.
    """
    for name, owners in _SOURCES.items():
        is_of_output = name == "mano" and args.from_mean
        if _is_given(args, name) and source not in owners and not is_of_output:
            raise LiveHandError(f"{_spelt(name)} is of {_listed(owners)}, got {source}; leave it out")


def _is_given(args: argparse.Namespace, name: str) -> bool:
    return getattr(args, name) not in (None, False)


def _spelt(name: str) -> str:
    return f"--{name.replace('_', '-')}"


def _listed(names: tuple[str, ...]) -> str:
    return " and ".join([*filter(None, [", ".join(names[:-1])]), names[-1]])
