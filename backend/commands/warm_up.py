"""`livehand warm-up` compiles the kernels ahead: numba keeps them on disk, and no first picture waits for them.

In Blender's window they are compiled in the background, once after an install: this is for farms, and for avatars with
networks of another size. Kernels of NVIDIA's GPUs are compiled when `--gpu` names chips, by Warp, without such a GPU.
"""

from __future__ import annotations

import argparse
import re
from importlib import import_module
from typing import Any

from ..avatars.library import AVATAR_HELP, avatar_path, shipped_avatar_path
from ..records.errors import LiveHandError
from ..system.command import Command


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--avatar", type=avatar_path, metavar="NAME|FILE", help=AVATAR_HELP)
    of_gpus = "instead, the kernels of NVIDIA GPUs with these compute capabilities, such as 8.6,8.9 (a minute each)"
    parser.add_argument("--gpu", type=chips, metavar="CHIPS", help=of_gpus)


def chips(text: str) -> tuple[int, ...]:
    """Read compute capabilities as Warp numbers chips: 8.6 is 86."""
    if not all(re.fullmatch(r"\d+\.\d", one) for one in text.split(",")):
        raise argparse.ArgumentTypeError(f"must be compute capabilities such as 8.6,8.9, got {text!r}")
    return tuple(int(one.replace(".", "")) for one in text.split(","))


def _compiled_for(chips: tuple[int, ...]) -> dict[str, Any]:
    try:
        import_module("warp")
    except ModuleNotFoundError:
        raise LiveHandError(
            "kernels of GPUs must be compiled by Warp, got none; install the extra: livehand[gpu]"
        ) from None
    from ..compute.gpu.ahead import compile_kernels

    done = compile_kernels(chips)
    return {
        "compiled": True,
        "seconds": round(done.seconds, 1),
        "folder": str(done.folder),
        "bytes": done.size_bytes,
        "summary": f"{len(done.files)} modules compiled in {done.seconds:.0f} s, kept in {done.folder}",
    }


def _run(args: argparse.Namespace) -> dict[str, Any]:
    """Compile the kernels, and report how long it took and where they are kept.

    Raises:
        LiveHandError: the avatar cannot be read; or Warp is not installed, or knows no such chip.
    """
    if args.gpu:
        return _compiled_for(args.gpu)
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
