"""The one on-disk multi-view format, written by `livehand capture`, by importers, and by users.

A folder with
- `transforms.json`: provenance, and per image its file, K (px), cam2world (OpenCV axes, m), size, camera index, pose
  index and split;
- `poses.npz`: theta [P, 16, 3] rad, beta [P, 10], transl [P, 3] m, side;
- images: RGBA, sRGB-encoded, straight (not premultiplied) alpha, as any PNG.
"""

from __future__ import annotations

import json
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args
from zipfile import BadZipFile

import numpy as np
from PIL import Image

from .camera import Camera
from .errors import LiveHandError
from .shot import HandPose, Side

FORMAT = "livehand-capture"
VERSION = 1

Split = Literal["train", "novel_pose", "novel_camera", "test"]
"""Held-out pose seen by a training camera, training pose seen by a held-out camera, `test`: both held out."""


@dataclass(frozen=True)
class CaptureView:
    """One image of a capture."""

    file: str
    camera: Camera
    camera_index: int
    pose_index: int
    split: Split


@dataclass(frozen=True)
class Capture:
    """A capture folder, read and checked; images stay on disk until asked for."""

    folder: Path
    hand_sha256: str
    provenance: dict
    poses: tuple[HandPose, ...]
    views: tuple[CaptureView, ...]

    def of_split(self, split: Split) -> tuple[CaptureView, ...]:
        """The views of one split, in file order."""
        return tuple(view for view in self.views if view.split == split)

    def read_image(self, view: CaptureView) -> np.ndarray:
        """[H, W, 4] float32: sRGB-encoded colour times alpha (the image on black), and alpha.

        Raises:
            LiveHandError: the image is missing, unreadable, not RGBA, or not of the view's size.
        """
        path = self.folder / view.file
        try:
            with Image.open(path) as image:
                mode, size = image.mode, image.size
                pixels = np.asarray(image.convert("RGBA"), np.float32) / 255
        except OSError as error:
            raise LiveHandError(f"capture image {path} must be a readable picture ({error})") from error
        if mode not in ("RGBA", "LA"):
            raise LiveHandError(f"capture image {path} must carry alpha (RGBA), got mode {mode}; mask the hand")
        if size != tuple(view.camera.size_px):
            raise LiveHandError(f"capture image {path} must be {view.camera.size_px} px as its camera says, got {size}")
        return np.concatenate([pixels[..., :3] * pixels[..., 3:], pixels[..., 3:]], -1)


def load_capture(folder: Path | str) -> Capture:
    """Read and check a capture folder.

    Raises:
        LiveHandError: naming the file and the fault.
    """
    folder = Path(folder)
    document = _read_json(folder / "transforms.json")
    if document.get("format") != FORMAT or document.get("version") != VERSION:
        raise LiveHandError(
            f"{folder / 'transforms.json'} must say format {FORMAT} version {VERSION}, "
            f"got {document.get('format')!r} {document.get('version')!r}"
        )
    poses = _read_poses(folder / "poses.npz")
    frames, hand_sha256 = document.get("frames"), document.get("hand_sha256")
    if not isinstance(frames, list) or not isinstance(hand_sha256, str):
        raise LiveHandError(f"{folder / 'transforms.json'} must have a list of frames and the hand's hand_sha256")
    views = tuple(_read_view(entry, len(poses), folder) for entry in frames)
    return Capture(folder, hand_sha256, document.get("provenance", {}), poses, views)


def save_capture_index(capture: Capture) -> None:
    """Write `transforms.json` and `poses.npz`; the images are the writer's own business."""
    arrays = {name: np.stack([getattr(pose, name) for pose in capture.poses]) for name in ("theta", "beta", "transl")}
    np.savez_compressed(capture.folder / "poses.npz", side=np.array([pose.side for pose in capture.poses]), **arrays)
    (capture.folder / "transforms.json").write_text(index_document(capture))


def index_document(capture: Capture) -> str:
    """What `transforms.json` says of the capture."""
    document = {
        "format": FORMAT,
        "version": VERSION,
        "hand_sha256": capture.hand_sha256,
        "provenance": capture.provenance,
        "frames": [_view_entry(view) for view in capture.views],
    }
    return json.dumps(document, indent=1) + "\n"


def _view_entry(view: CaptureView) -> dict:
    return {
        "file_path": view.file,
        "split": view.split,
        "camera_index": view.camera_index,
        "pose_index": view.pose_index,
        "size_px": list(view.camera.size_px),
        "K": view.camera.K.tolist(),
        "cam2world": view.camera.cam2world.tolist(),
    }


def _read_view(entry: dict | object, pose_count: int, folder: Path) -> CaptureView:
    if not isinstance(entry, dict) or not isinstance(entry.get("file_path"), str):
        raise LiveHandError(f"{folder}: every frame in transforms.json must have a file_path, got {str(entry)[:40]}...")
    name, split = entry["file_path"], entry.get("split")
    if split not in get_args(Split):
        raise LiveHandError(f"{folder}: {name}: split must be one of {get_args(Split)}, got {split!r}")
    try:
        width, height = (int(n) for n in entry["size_px"])
        camera = Camera(np.array(entry["K"], float), np.array(entry["cam2world"], float), (width, height))
        view = CaptureView(name, camera, int(entry["camera_index"]), int(entry["pose_index"]), entry["split"])
    except KeyError as error:
        raise LiveHandError(f"{folder}: {name} must have a {error} in transforms.json, got none") from error
    except (ValueError, TypeError, LiveHandError) as error:
        raise LiveHandError(f"{folder}: {name}: {error}") from error
    if not 0 <= view.pose_index < pose_count:
        raise LiveHandError(f"{folder}: {name} must name one of {pose_count} poses, got {view.pose_index}")
    return view


def _read_poses(path: Path) -> tuple[HandPose, ...]:
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as arrays:
            rows = zip(arrays["theta"], arrays["beta"], arrays["transl"], arrays["side"], strict=True)
            return tuple(HandPose(theta, beta, transl, _side(str(side))) for theta, beta, transl, side in rows)
    except (OSError, EOFError, BadZipFile, zlib.error, KeyError, ValueError, TypeError, LiveHandError) as error:
        raise LiveHandError(f"{path} must hold theta, beta, transl and side of every pose ({error})") from error


def _side(name: str) -> Side:
    if name not in get_args(Side):
        raise LiveHandError(f"side must be 'right' or 'left', got {name!r}")
    return name  # type: ignore[return-value]


def _read_json(path: Path) -> dict:
    try:
        document = json.loads(path.read_text())
    except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise LiveHandError(
            f"{path} must be a capture's index ({error}); is {path.parent} a capture folder?"
        ) from error
    return document if isinstance(document, dict) else {}
