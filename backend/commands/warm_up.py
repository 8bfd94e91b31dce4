"""`livehand warm-up` compiles the kernels ahead: numba keeps them on disk, and no first picture waits for them."""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from typing import TYPE_CHECKING

from ..avatars.library import AVATAR_HELP, avatar_path
from ..system.command import Command

if TYPE_CHECKING:
    from ..hand.model import HandModel
    from ..records.shot import Shot

_SIDE_PX = 64


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--avatar", type=avatar_path, metavar="NAME|FILE", help=AVATAR_HELP)


def _run(args: argparse.Namespace) -> dict:
    from ..avatars.file import load_avatar
    from ..hand.model_file import load_default_hand
    from ..render.backends import has_numba, kernel_cache
    from ..render.renderer import Renderer

    if not has_numba():
        return {"compiled": False, "summary": "numba is not installed: there are no kernels to compile"}
    began, avatar = time.perf_counter(), load_avatar(args.avatar)
    hand = load_default_hand()
    for precision in ("bf16", "fp32"):
        renderer = Renderer(avatar, hand, "cpu", precision)
        for shot in _shots(hand):
            renderer.render(shot)
    took_s, folder = time.perf_counter() - began, kernel_cache()
    kept = f"kept in {folder}" if folder else "but no folder takes them: the next process compiles them again"
    return {
        "compiled": True,
        "seconds": round(took_s, 1),
        "folder": None if folder is None else str(folder),
        "summary": f"kernels compiled in {took_s:.0f} s, {kept}",
    }


def _shots(hand: HandModel) -> list[Shot]:
    """Make small pictures that need every kernel: in the avatar's own light, and between lamp, sky and occluder."""
    import numpy as np

    from ..hand.lbs import posed_vertices
    from ..records.camera import Camera, look_at
    from ..records.light import Light
    from ..records.shot import HandPose, Shot
    from ..render.studio_light import studio_light

    pose = HandPose(np.zeros((16, 3)), np.zeros(10), np.zeros(3), hand.side)
    vertices = posed_vertices(hand, pose)
    centre, size_m = vertices.mean(0), float(np.ptp(vertices, axis=0).max())
    K = np.array([[_SIDE_PX, 0, _SIDE_PX / 2], [0, _SIDE_PX, _SIDE_PX / 2], [0, 0, 1.0]])
    cam2world = look_at(centre + size_m * np.array([0, 1.5, 0.2]), centre, np.array([0, 0, 1.0]))
    shot = Shot(pose, vertices, Camera(K, cam2world, (_SIDE_PX, _SIDE_PX)))
    beside = centre + size_m * np.array([[2.0, 0, 0], [2, 0.1, 0], [2, 0, 0.1]])
    studio = studio_light()
    occluded = Light(studio.lamps, studio.sky, occluders=beside[None].astype(np.float32))
    return [shot, replace(shot, light=studio), replace(shot, light=occluded)]


COMMAND = Command("warm-up", "compile the kernels ahead, once on a machine", _add_arguments, _run)
