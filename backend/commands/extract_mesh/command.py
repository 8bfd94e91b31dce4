"""`livehand extract-mesh`: a triangle mesh of an avatar's density, in a pose of the library."""

from __future__ import annotations

import argparse
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

from ...avatars.library import AVATAR_HELP, avatar_path
from ...hand.poses import POSES
from ...records.errors import LiveHandError
from ...system.command import Command
from ...system.files import replacing

_SUFFIXES = (".ply", ".obj", ".stl")
_REST = "rest"


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("avatar", type=avatar_path, help=AVATAR_HELP)
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="FILE", help="mesh: .ply, .obj or .stl, m")
    parser.add_argument("--hand", type=Path, metavar="FILE", help="hand model of the avatar (default: built-in)")
    parser.add_argument("--pose", choices=(_REST, *POSES), default=_REST, metavar="NAME", help="default: %(default)s")
    parser.add_argument(
        "--density",
        type=_positive,
        default=math.log(2),
        metavar="PER_MM",
        help="of the surface (default: 0.69, at which a millimetre takes half of the light)",
    )
    parser.add_argument(
        "--spacing", type=_positive, default=1.5, metavar="MM", help="of the grid (default: %(default)g)"
    )


def _positive(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"must be a number above 0, got {text!r}")
    return value


def _run(args: argparse.Namespace) -> dict[str, Any]:
    if args.output.suffix.lower() not in _SUFFIXES:
        raise LiveHandError(f"a mesh must be written to one of {', '.join(_SUFFIXES)}, got {args.output.name}")
    import numpy as np
    import trimesh

    from ...avatars.file import load_avatar
    from ...geometry.contour import zero_surface
    from ...hand.gestures import FingerAxes, theta_of
    from ...hand.lbs import posed_vertices
    from ...hand.model_file import DEFAULT_HAND, load_hand_model
    from ...records.camera import Camera
    from ...records.shot import HandPose, Shot, SurfaceMesh
    from ...render.renderer import Renderer
    from .density_volume import density_volume, distances_m

    hand = load_hand_model(args.hand or DEFAULT_HAND)
    renderer = Renderer(load_avatar(args.avatar), hand, "cpu")
    pose = HandPose.rest(hand.side)
    if args.pose != _REST:
        angles_deg = POSES[args.pose].gesture.angles_deg()
        pose = replace(pose, theta=theta_of(angles_deg, FingerAxes.of_default_hand()))
    shot = Shot(pose, posed_vertices(hand, pose), Camera(np.eye(3), np.eye(4), (1, 1)))
    volume = density_volume(renderer, shot, args.density, args.spacing / 1000)
    vertices, faces = zero_surface(volume.values, volume.origin, volume.spacing)
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    surface = renderer.posed_surface(shot) or SurfaceMesh(np.asarray(shot.vertices), hand.f)
    apart_mm = 1000 * distances_m(vertices, surface)
    args.output.parent.mkdir(parents=True, exist_ok=True)
    with replacing(args.output) as temporary:
        mesh.export(temporary, file_type=args.output.suffix.lower().removeprefix("."))
    mean, most = float(apart_mm.mean()), float(np.percentile(apart_mm, 95))
    return {
        "mesh": str(args.output),
        "vertices": len(vertices),
        "faces": len(faces),
        "is_watertight": bool(mesh.is_watertight),
        "surface_error_mean_mm": round(mean, 3),
        "surface_error_p95_mm": round(most, 3),
        "summary": f"{args.output}: {len(faces)} faces; mean error {mean:.2f} mm, 95 % within {most:.2f} mm",
    }


COMMAND = Command("extract-mesh", "extract a mesh of an avatar's density", _add_arguments, _run)
