"""`livehand warm-up` compiles the kernels ahead: numba keeps them on disk, and no first picture waits for them.

In Blender's window they are compiled in the background, once after an install: this is for farms, and for avatars with
networks of another size.
"""

from __future__ import annotations

import argparse
from typing import Any

from ..avatars.library import AVATAR_HELP, avatar_path, shipped_avatar_path
from ..system.command import Command


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--avatar", type=avatar_path, metavar="NAME|FILE", help=AVATAR_HELP)


def _run(args: argparse.Namespace) -> dict[str, Any]:
    """Compile the kernels, and report how long it took and where they are kept.

    Raises:
        LiveHandError: the avatar cannot be read.
    """
    from ..render.ahead.kernels import prepare_kernels
    from ..render.backends import has_numba

    if not has_numba():
        return {"compiled": False, "summary": "numba is not installed: there are no kernels to compile"}
    took_s, folder = prepare_kernels(args.avatar or shipped_avatar_path())
    where = f"kept in {folder}" if folder else "but no folder takes them: the next process compiles them again"
    return {
        "compiled": True,
        "seconds": round(took_s, 1),
        "folder": None if folder is None else str(folder),
        "summary": f"kernels compiled in {took_s:.0f} s, {where}",
    }


COMMAND = Command("warm-up", "compile the kernels ahead, once on a machine", _add_arguments, _run)
