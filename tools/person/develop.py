"""Make a phone's film of linear pictures: `python -m livehand.tools.person.develop stranger1 FOLDER`.

A wall behind the hand, exposure that follows it, white balance that drifts, noise, and H.264. Reads `linear/*.exr` and
`factor.npz` of `film.py`, writes `film.mp4`, `back.mp4` (its start, which does not show the palm) and `truth.npz`.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
import torch
from scipy.ndimage import map_coordinates, zoom

from ...backend.image.srgb import linear_to_srgb
from ...backend.records.camera import Camera
from ...backend.tracking.video_writer import write_video
from .script import BACK_FRAMES, FPS, film_cameras
from .skin_points import skin_points
from .strangers import STRANGERS
from .truth import drawn_texels, read_rgba, write_truth

WHITE_PERCENTILE, WHITE = 96.0, 0.8
"""The hand's brightest channel at this percentile becomes this linear value."""
WANDER = 0.10
"""By which exposure and white balance go wrong."""
_LAG_S = 0.5
_SHOT_NOISE, _READ_NOISE = 0.0005, 0.002  # variance per linear signal, and deviation
_WALL_M, _WALL_SIDE_M = 1.6, 4.0  # behind the hand, and its side
_WALL_PX = 800
_WALL_RGB = np.array([0.20, 0.22, 0.24])
_SHELF_RGB = np.array([0.07, 0.045, 0.03])


def main(arguments: list[str] | None = None) -> None:
    """Develop the film."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("stranger", choices=STRANGERS)
    parser.add_argument("folder", type=Path)
    parser.add_argument(
        "--every", type=int, default=1, metavar="N", help="of the script's frames, where only these are rendered"
    )
    args = parser.parse_args(arguments)
    stranger, folder = STRANGERS[args.stranger], args.folder
    cameras, fps = film_cameras()[:: args.every], FPS / args.every
    paths = [folder / "linear" / f"{args.every * index:03d}.exr" for index in range(len(cameras))]
    gains = film_gains(np.array([brightness(read_rgba(path)) for path in paths]), fps, stranger.seed)
    rng = np.random.default_rng(stranger.seed)
    wall = made_wall(rng)
    frames = [
        developed(read_rgba(path), behind(camera, wall), gain, rng)
        for path, camera, gain in zip(paths, cameras, gains, strict=True)
    ]
    times = np.arange(len(frames)) / fps
    write_video(frames, folder / "film.mp4", times, fps)
    write_video(frames[: -(-BACK_FRAMES // args.every)], folder / "back.mp4", times, fps)
    with np.load(folder / "factor.npz") as arrays:
        log_factor = arrays["log_factor"]
    drawn = drawn_texels(stranger, skin_points(len(log_factor)))
    write_truth(folder, stranger, args.every, gains, log_factor, drawn)
    sys.stdout.write(f"{folder / 'film.mp4'}: {len(frames)} frames\n")


def brightness(picture: np.ndarray) -> float:
    """Measure what a camera exposes by, of linear premultiplied pixels [H, W, 4]."""
    on_hand = picture[picture[..., 3] > 0.9, :3]
    return float(np.percentile(on_hand.max(-1), WHITE_PERCENTILE))


def film_gains(bright: np.ndarray, fps: float, seed: int) -> np.ndarray:
    """Compute the gains [T, 3] of frames of such brightness [T]: they follow late, and drift by `WANDER`."""
    share, followed = 1 - np.exp(-1 / (fps * _LAG_S)), [float(bright[0])]
    for value in bright[1:]:
        followed.append(followed[-1] + share * (float(value) - followed[-1]))
    t, phases = np.arange(len(bright)) / fps, np.random.default_rng(seed).uniform(0, 2 * np.pi, 3)
    exposure, warmth, tint = (np.sin(2 * np.pi * t / s + phase) for s, phase in zip((7, 11, 9), phases, strict=True))
    logs = np.stack([warmth, tint / 4, -warmth], 1) + exposure[:, None] / 2
    return WHITE / np.array(followed)[:, None] * np.exp(np.log1p(WANDER) * logs)


def made_wall(rng: np.random.Generator) -> np.ndarray:
    """Make a rough painted wall with a shelf, linear [N, N, 3], top row first."""
    rough = np.zeros((_WALL_PX, _WALL_PX))
    for cells in (4, 10, 25, 100):
        rough += np.asarray(zoom(rng.normal(size=(cells, cells)), _WALL_PX / cells, order=1)) / cells**0.5
    wall = _WALL_RGB * np.exp(0.25 * rough)[..., None]
    shelf = slice(round(0.56 * _WALL_PX), round(0.60 * _WALL_PX))
    wall[shelf] = _SHELF_RGB * np.exp(0.2 * rough[shelf])[..., None]
    return wall


def behind(camera: Camera, wall: np.ndarray) -> np.ndarray:
    """Show the wall [H, W, 3], a plane across Blender's +Y, as a camera sees it."""
    width, height = camera.size_px
    columns, rows = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    directions = camera.ray_directions(np.stack([columns, rows], -1))
    at = camera.origin + directions * ((_WALL_M - camera.origin[1]) / directions[..., 1])[..., None]
    texel = len(wall) / _WALL_SIDE_M
    texels = np.stack([_WALL_SIDE_M / 2 - at[..., 2], _WALL_SIDE_M / 2 + at[..., 0]]) * texel - 0.5
    return np.stack([map_coordinates(wall[..., k], texels, order=1, mode="nearest") for k in range(3)], -1)


def developed(picture: np.ndarray, ground: np.ndarray, gain: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Develop linear premultiplied pixels [H, W, 4] before a ground [H, W, 3] to uint8, clipped and noisy."""
    linear = gain * (picture[..., :3] + ground * (1 - picture[..., 3:]))
    deviation = np.sqrt(_READ_NOISE**2 + _SHOT_NOISE * linear)
    noisy = np.clip(linear + deviation * rng.normal(size=linear.shape), 0, 1)
    return (255 * linear_to_srgb(torch.as_tensor(noisy)).numpy()).round().astype(np.uint8)


if __name__ == "__main__":
    main()
