"""What is known about a stranger's film: `truth.npz` in its folder, beside the pictures of the kept scenes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...backend.capture.exr import read_exr
from ...backend.hand.lbs import posed_vertices
from ...backend.hand.model import HandModel
from ...backend.hand.model_file import load_default_hand
from ...backend.records.camera import Camera
from ...backend.records.shot import Shot
from .script import FPS, film_cameras, film_light, film_motion, kept_scenes
from .skin_points import BakedPoints
from .strangers import Stranger, Stroke, ink

TRUTH_FILE = "truth.npz"
_AROUND_MM = 3.0  # of a drawing, which belongs to where maps are compared


@dataclass(frozen=True)
class Truth:
    """A stranger and their film of T frames.

    Attributes:
        folder: of the film.
        melanin: of the stranger.
        theta, transl, forearm: [T, 16, 3], [T, 3] and [T, 3] of the hand in Blender's world.
        beta: [10].
        cameras: T.
        gains: [T, 3] by which the camera multiplied linear colours.
        log_factor: [A, A, 3] logarithm of the factor on albedo; the row of the smallest v first.
        drawn: [A, A] bool: tattoos and scars of the back, and what is around them.
        fps: frames of the film a second.
    """

    folder: Path
    melanin: float
    theta: np.ndarray
    beta: np.ndarray
    transl: np.ndarray
    forearm: np.ndarray
    cameras: tuple[Camera, ...]
    gains: np.ndarray
    log_factor: np.ndarray
    drawn: np.ndarray
    fps: float

    def scenes(self, hand: HandModel, beta: np.ndarray) -> list[Shot]:
        """Pose the kept scenes with a shape [10]."""
        return [
            Shot(scene.pose, posed_vertices(hand, scene.pose), scene.camera, scene.light)
            for scene in kept_scenes(hand, beta)
        ]

    def pictures(self) -> list[np.ndarray]:
        """Read the kept scenes' pictures [H, W, 4]: scene-linear, premultiplied colour and alpha."""
        paths = sorted((self.folder / "scenes").glob("*.exr"), key=lambda path: int(path.stem))
        return [read_rgba(path) for path in paths]


def write_truth(
    folder: Path,
    stranger: Stranger,
    every: int,
    gains: np.ndarray,
    log_factor: np.ndarray,
    drawn: np.ndarray,
) -> None:
    """Write `truth.npz`: the arrays of `Truth`, K and cam2world of the cameras, the film's lamp, sky and rate.

    The film shows every so many frames of the script.
    """
    beta = np.array(stranger.person.beta)
    motion, cameras, light = (
        film_motion(load_default_hand(), beta, stranger.seed),
        film_cameras()[::every],
        film_light(),
    )
    (lamp,), sky = light.lamps, light.sky
    np.savez_compressed(
        folder / TRUTH_FILE,
        melanin=stranger.person.melanin,
        theta=motion.theta[::every],
        beta=beta,
        transl=motion.transl[::every],
        forearm=motion.forearms[::every],
        K=np.stack([camera.K for camera in cameras]),
        cam2world=np.stack([camera.cam2world for camera in cameras]),
        size_px=cameras[0].size_px,
        gains=gains,
        log_factor=log_factor.astype(np.float16),
        drawn=drawn,
        fps=FPS / every,
        lamp_rgb=lamp.rgb,
        lamp_position=lamp.position,
        lamp_rotation=lamp.rotation,
        lamp_size_m=lamp.size_m,
        sky=np.zeros((1, 2, 3)) if sky is None else sky.radiance,
    )


def read_truth(folder: Path) -> Truth:
    """Read the truth of a folder."""
    with np.load(folder / TRUTH_FILE) as arrays:
        width, height = arrays["size_px"].tolist()
        placed = zip(arrays["K"], arrays["cam2world"], strict=True)
        cameras = tuple(Camera(K, cam2world, (width, height)) for K, cam2world in placed)
        own = {name: arrays[name] for name in ("theta", "beta", "transl", "forearm", "gains", "drawn")}
        factor = arrays["log_factor"].astype(np.float32)
        melanin, fps = float(arrays["melanin"]), float(arrays["fps"])
        return Truth(folder, melanin, cameras=cameras, log_factor=factor, fps=fps, **own)


def read_rgba(path: Path) -> np.ndarray:
    """Read a picture [H, W, 4] float32."""
    channels = read_exr(path)
    return np.stack([channels[name] for name in "RGBA"], -1).astype(np.float32)


def drawn_texels(stranger: Stranger, points: BakedPoints) -> np.ndarray:
    """Find the texels [A, A] of the back's drawings and 3 mm around them; none of a stranger without drawings."""
    strokes = [_widened(stroke) for stroke in stranger.strokes if stroke.is_dorsal]
    none = np.zeros(len(points.at_mm))
    inked = np.max([none, *(ink(stroke, points.at_mm, points.normals) for stroke in strokes)], 0) > 0.5
    resolution = points.texels.resolution
    drawn = np.zeros(resolution**2, bool)
    drawn[points.texels.pixel[inked]] = True
    return drawn.reshape(resolution, resolution)


def _widened(stroke: Stroke) -> Stroke:
    return Stroke(stroke.points_mm, stroke.width_mm + 2 * _AROUND_MM, stroke.log_rgb, stroke.is_dorsal)
