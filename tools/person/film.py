"""Film a stranger: `python -m livehand.tools.person.film stranger1 -o DIR`; an interrupted run goes on where it was.

The folder gets linear pictures of the hand, `linear/*.exr` of the film's frames and `scenes/*.exr` of the kept scenes,
and the factor on albedo over the atlas, `factor.npz`. `develop` makes the film of them.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

from ...backend.hand.model_file import load_default_hand
from .script import FRAMES, Scene, film_cameras, film_light, film_motion, kept_scenes
from .skin_points import skin_points
from .strangers import STRANGERS, Stranger, log_factor

_ATLAS_PX = 1024
_STRIDE = 3


def main(arguments: list[str] | None = None) -> None:
    """Render, develop and describe."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("stranger", choices=STRANGERS)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--samples", type=int, default=8)
    parser.add_argument("--scene-samples", type=int, default=32)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument(
        "--every", type=int, default=1, metavar="N", help="of the script's frames; `develop` takes it, too"
    )
    args = parser.parse_args(arguments)
    _render(args, STRANGERS[args.stranger])


def _render(args: argparse.Namespace, stranger: Stranger) -> None:
    from .filming import Job, Studio, render_missing  # needs Blender as a module

    model, folder = load_default_hand(), args.output
    for name in ("linear", "scenes", "skin"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    studio = Studio(
        model, stranger.person, _stored_factor(stranger, folder / "factor.npz"), folder / "skin", args.threads
    )
    scenes = scenes_of(stranger)
    kept = [Job(folder / "scenes" / f"{index}.exr", scene, index) for index, scene in enumerate(scenes[FRAMES:])]
    film = [Job(folder / "linear" / f"{index:03d}.exr", scene, index) for index, scene in enumerate(scenes[:FRAMES])]
    render_missing(studio, kept, args.scene_samples, _say)
    film = film[:: args.every]
    for first in range(_STRIDE):  # a film that is interrupted shows all of its turn
        render_missing(studio, film[first::_STRIDE], args.samples, _say)


def _stored_factor(stranger: Stranger, path: Path) -> np.ndarray:
    if not path.is_file():
        np.savez_compressed(path, log_factor=atlas_factor(stranger).astype(np.float16))
    with np.load(path) as arrays:
        return arrays["log_factor"].astype(np.float32)


def scenes_of(stranger: Stranger) -> list[Scene]:
    """Return the film's frames, then the kept scenes."""
    model, beta = load_default_hand(), np.array(stranger.person.beta)
    motion, light = film_motion(model, beta, stranger.seed), film_light()
    frames = [Scene(f"{index:03d}", motion.pose(index), camera, light) for index, camera in enumerate(film_cameras())]
    return [*frames, *kept_scenes(model, beta)]


def atlas_factor(stranger: Stranger) -> np.ndarray:
    """Return the logarithm [A, A, 3] of the stranger's factor over the atlas, the row of the smallest v first."""
    points = skin_points(_ATLAS_PX)
    return points.texels.as_map(log_factor(stranger, points.at_mm, points.normals).astype(np.float32))


def _say(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
