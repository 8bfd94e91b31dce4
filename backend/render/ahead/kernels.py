"""Kernels are compiled by small pictures that need every one of them; those of contact by themselves."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from ...hand.model import HandModel

if TYPE_CHECKING:
    from ...records.shot import Shot
    from ..renderer import Renderer

_SIDE_PX = 32


class Prepared(NamedTuple):
    """How long it took, s, and the folder that keeps the kernels; None: no folder takes them."""

    seconds: float
    folder: Path | None


def prepare_kernels(avatar_path: Path) -> Prepared:
    """Compile the kernels that render this avatar of the built-in hand; numba must be there.

    Raises:
        LiveHandError: the avatar cannot be read.
    """
    from ...avatars.file import load_avatar
    from ...compute.kernels.cache_folder import mark_prepared
    from ...hand.model_file import load_default_hand
    from ..backends import kernel_cache
    from ..renderer import Renderer

    began, avatar, hand = time.perf_counter(), load_avatar(avatar_path), load_default_hand()
    for precision in ("fp32", "bf16"):
        _render_small(Renderer(avatar, hand, "cpu", precision), hand)
    _find_near()
    folder = kernel_cache()
    if folder is not None:
        mark_prepared(folder)
    return Prepared(time.perf_counter() - began, folder)


def prepare_share(avatar_path: Path, number: int, count: int, on_first: Callable[[], None]) -> None:
    """Compile the share of one of `count` processes in the kernels of first pictures.

    The first of all is a view's coarse one; when its kernels are there, `on_first` is called. Those of the finished
    picture at full precision follow.

    Raises:
        LiveHandError: the avatar cannot be read.
    """
    from ...avatars.file import load_avatar
    from ...compute.cpu.backend import share_of_backend
    from ...compute.cpu.surface import SurfaceKernels
    from ...hand.model_file import load_default_hand
    from ..renderer import Renderer

    avatar, hand, backend = load_avatar(avatar_path), load_default_hand(), share_of_backend(number, count)
    has_skin_detail = isinstance(backend, SurfaceKernels)  # for the others it would be made in vain
    renderer = Renderer(avatar, hand, "cpu", backend=backend, has_skin_detail=has_skin_detail)
    shot = _shots(hand)[0]  # the others need no more kernels, and the reference is slow
    renderer.render(replace(shot, quality="preview"))
    on_first()
    renderer.render(shot)


def _render_small(renderer: Renderer, hand: HandModel) -> None:
    for shot in _shots(hand):
        renderer.render(shot)


def _find_near() -> None:
    """Ask the kernels that *Grasp* needs what is nearest to a corner of a triangle."""
    import numpy as np

    from ...compute.kernels.near_points import find_near_points
    from ...compute.kernels.nearest import find_nearest, triangle_tree

    corners, found = np.eye(3), np.empty(1, np.int64)
    find_nearest(corners[:1], triangle_tree(corners[None]), found, np.empty((1, 3)))
    find_near_points(corners, found * 0, np.arange(1, 3), 1.0, 2.0, found)


def _shots(hand: HandModel) -> list[Shot]:
    """Make small pictures that need every kernel: in the avatar's own light, and between lamp, sky and occluder."""
    import numpy as np

    from ...hand.lbs import posed_vertices
    from ...records.camera import Camera, look_at
    from ...records.light import Light
    from ...records.shot import HandPose, Shot
    from ..studio_light import studio_light

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
