"""The multi-view file format, written by `livehand capture`, by importers and by users.

A capture is a folder with
- `transforms.json`: provenance, and for each image its file, K (px), cam2world (OpenCV axes, m), size, camera index,
  pose index, split and, if it has one, the file of its mask;
- in version 2, the lights of the images too (`lights`), whose skies are files;
- `poses.npz`: theta [P, 16, 3] rad, beta [P, 10], transl [P, 3] m, side, and if any is turned, forearm [P, 3] rad;
- `surface.npz`, if the surface of the hand is known: `surface/surface_file.py` documents it;
- images: sRGB-encoded RGBA with straight (not premultiplied) alpha; or scene-linear OpenEXR with premultiplied alpha;
  or images without alpha and for each a mask, a grey image of the same size that is white on the hand.

docs/make/captures.md documents the format for users.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, NamedTuple, get_args

import numpy as np

from ..records.camera import Camera
from ..records.errors import LiveHandError
from ..records.light import Light
from ..records.shot import HandPose
from ..records.side import Side
from ..system.files import inner_path, replacing
from ..system.readers import npz_bytes, read_json, read_npz
from .lights import CaptureLight, light_entry, read_light, write_skies
from .picture import ALPHA_MODES, no_alpha, read_linear_picture, read_mask, read_picture, srgb_to_linear, straight

FORMAT = "livehand-capture"
VERSION, LIT_VERSION = 1, 2
"""Of captures without and with lights."""

Split = Literal["train", "novel_pose", "novel_camera", "test", "novel_light"]
"""`novel_pose` has a held-out pose and a training camera, `novel_camera` the opposite; in `test` both are held out.

`novel_light` has a training pose and camera in a light of no training image; the lights of `test` are held out too.
"""


@dataclass(frozen=True)
class CaptureView:
    """One image of a capture.

    Attributes:
        file: relative to the capture's folder.
        camera: its view.
        camera_index: which camera.
        pose_index: which pose.
        split: whether it is trained on, and if not, what is new in it.
        mask: the file of its alpha; None: the image has an alpha channel.
        light: which of the capture's lights, None: not known. Of a light group, all that the image shows is in the
            light of that group; images of one pose and camera show the same hand.
        exposure: file value = linear value x exposure.
    """

    file: str
    camera: Camera
    camera_index: int
    pose_index: int
    split: Split
    mask: str | None = None
    light: int | None = None
    exposure: float = 1.0

    @property
    def is_linear(self) -> bool:
        """Whether the file is OpenEXR; other files are sRGB-encoded."""
        return self.file.lower().endswith(".exr")


class SurfaceReference(NamedTuple):
    """The file of the surface that a capture shows.

    Attributes:
        file: relative to the capture's folder.
        sha256: of the surface (`surface_file.surface_sha256`).
    """

    file: str
    sha256: str


@dataclass(frozen=True)
class Capture:
    """The index, poses and lights of a capture folder; images and surface are read on request.

    Attributes:
        identities: who shows each pose, in captures joined of several people's (`joined`); empty: one person.
    """

    folder: Path
    hand_sha256: str
    provenance: dict
    poses: tuple[HandPose, ...]
    views: tuple[CaptureView, ...]
    lights: tuple[CaptureLight, ...] = ()
    surface: SurfaceReference | None = None
    identities: tuple[int, ...] = ()

    @property
    def is_lit(self) -> bool:
        """Whether it has what only version 2 can say: lights, exposures or linear images."""
        return bool(self.lights) or any(
            view.light is not None or view.exposure != 1 or view.is_linear for view in self.views
        )

    def of_split(self, split: Split) -> tuple[CaptureView, ...]:
        """Select the views of one split, in file order."""
        return tuple(view for view in self.views if view.split == split)

    def light_of(self, view: CaptureView) -> Light | None:
        """Look up the light of a view; None: not known."""
        return None if view.light is None else self.lights[view.light].light

    def read_linear(self, view: CaptureView) -> np.ndarray:
        """Read [H, W, 4] float32 of any view: scene-linear Rec.709 colour premultiplied by alpha, and alpha.

        Colours are as the light makes them: the exposure is divided out.

        Raises:
            LiveHandError: as `read_image`, for the image or its mask.
        """
        if view.is_linear:
            pixels = read_linear_picture(self.folder / view.file, view.camera.size_px, view.mask is not None)
        else:
            pixels = self.read_pixels(view).astype(np.float32) / 255
            pixels[..., :3] = srgb_to_linear(pixels[..., :3]) * pixels[..., 3:]
        if view.is_linear and view.mask is not None:
            alpha = read_mask(self.folder / view.mask, view.camera.size_px)[..., None].astype(np.float32) / 255
            pixels = np.concatenate([straight(pixels) * alpha, alpha], -1)
        pixels[..., :3] /= view.exposure
        return pixels

    def read_image(self, view: CaptureView) -> np.ndarray:
        """Read [H, W, 4] float32: sRGB-encoded colour times alpha (the image on black), and alpha.

        Raises:
            LiveHandError: the image is missing, unreadable, not RGBA, or not of the view's size.
        """
        pixels = self.read_pixels(view).astype(np.float32) / 255
        return np.concatenate([pixels[..., :3] * pixels[..., 3:], pixels[..., 3:]], -1)

    def read_pixels(self, view: CaptureView) -> np.ndarray:
        """Read [H, W, 4] uint8: straight sRGB-encoded colour, and alpha.

        Raises:
            LiveHandError: as `read_image`, for the image or its mask.
        """
        if view.is_linear:
            raise LiveHandError(f"{self.folder / view.file} must be an 8-bit image here, got linear OpenEXR")
        mode, pixels = read_picture(self.folder / view.file, "RGBA", view.camera.size_px)
        if view.mask is not None:
            alpha = read_mask(self.folder / view.mask, view.camera.size_px)
            return np.concatenate([pixels[..., :3], alpha[..., None]], -1)
        if mode not in ALPHA_MODES:
            raise LiveHandError(no_alpha(self.folder / view.file, mode))
        return pixels


def load_capture(folder: Path | str) -> Capture:
    """Read and check a capture folder's index and poses; `check_capture` checks the images too.

    Raises:
        LiveHandError: with the file and its faults.
    """
    folder = Path(folder)
    document = _read_json(folder / "transforms.json")
    version = document.get("version")
    if document.get("format") != FORMAT or version not in (VERSION, LIT_VERSION):
        raise LiveHandError(
            f"{folder / 'transforms.json'} must say format {FORMAT} version {VERSION} or {LIT_VERSION}, "
            f"got {document.get('format')!r} {document.get('version')!r}"
        )
    poses = _read_poses(folder / "poses.npz")
    frames, hand_sha256 = document.get("frames"), document.get("hand_sha256")
    if not isinstance(frames, list) or not isinstance(hand_sha256, str):
        raise LiveHandError(f"{folder / 'transforms.json'} must have a list of frames and the hand's hand_sha256")
    provenance, surface = document.get("provenance", {}), _surface_of(document, folder)
    if version == VERSION:
        views = read_all(folder, ((_read_view, entry, len(poses)) for entry in frames))
        return Capture(folder, hand_sha256, provenance, poses, views, surface=surface)
    entries = document.get("lights", [])
    if not isinstance(entries, list):
        raise LiveHandError(f"{folder / 'transforms.json'} must have a list of lights, got {str(entries)[:40]}")
    lights = read_all(folder, ((read_light, folder, f"lights[{index}]", entry) for index, entry in enumerate(entries)))
    views = read_all(folder, ((_read_lit_view, entry, len(poses), len(lights)) for entry in frames))
    return Capture(folder, hand_sha256, provenance, poses, views, lights, surface)


def save_capture_index(capture: Capture) -> None:
    """Write the lights' skies, `poses.npz` and `transforms.json`, each under a temporary name first, in this order.

    The caller writes the images.
    """
    write_skies(capture.folder, capture.lights)
    names = ["theta", "beta", "transl"]
    if any(pose.forearm.any() for pose in capture.poses):
        names.append("forearm")
    arrays = {name: np.stack([getattr(pose, name) for pose in capture.poses]) for name in names}
    arrays["side"] = np.array([pose.side for pose in capture.poses])
    with replacing(capture.folder / "poses.npz") as temporary:
        temporary.write_bytes(npz_bytes(arrays))
    with replacing(capture.folder / "transforms.json") as temporary:
        temporary.write_text(index_document(capture))


def index_document(capture: Capture) -> str:
    """Write out the capture's `transforms.json` as text."""
    document = {
        "format": FORMAT,
        "version": LIT_VERSION if capture.is_lit else VERSION,
        "hand_sha256": capture.hand_sha256,
        "provenance": capture.provenance,
        **({} if capture.surface is None else {"surface": capture.surface._asdict()}),
        "frames": [_view_entry(view) for view in capture.views],
    }
    if capture.is_lit:
        document["lights"] = [light_entry(index, light) for index, light in enumerate(capture.lights)]
    return json.dumps(document, indent=1) + "\n"


def _surface_of(document: dict, folder: Path) -> SurfaceReference | None:
    reported = document.get("surface")
    if reported is None:
        return None
    if not isinstance(reported, dict) or not all(
        isinstance(reported.get(key), str) for key in SurfaceReference._fields
    ):
        raise LiveHandError(
            f"{folder / 'transforms.json'}: surface must have a file and its sha256, got {str(reported)[:80]}"
        )
    return SurfaceReference(reported["file"], reported["sha256"])


def _view_entry(view: CaptureView) -> dict:
    mask = {} if view.mask is None else {"mask_path": view.mask}
    light = {} if view.light is None else {"light": view.light}
    exposure = {} if view.exposure == 1 else {"exposure": view.exposure}
    return {
        "file_path": view.file,
        **mask,
        "split": view.split,
        "camera_index": view.camera_index,
        "pose_index": view.pose_index,
        "size_px": list(view.camera.size_px),
        "K": view.camera.K.tolist(),
        "cam2world": view.camera.cam2world.tolist(),
        **light,
        **exposure,
    }


def read_all(path: Path, calls: Iterable[tuple]) -> tuple:
    """Collect the results of all calls (function, *arguments), which read parts of the file.

    Raises:
        LiveHandError: with the faults of all calls.
    """
    results, faults = [], []
    for function, *arguments in calls:
        try:
            results.append(function(*arguments))
        except LiveHandError as error:
            faults.append(str(error))
    if faults:
        raise LiveHandError.of_faults(str(path), faults)
    return tuple(results)


def _read_view(entry: dict | object, pose_count: int) -> CaptureView:
    if not isinstance(entry, dict) or not isinstance(entry.get("file_path"), str):
        raise LiveHandError(f"every frame in transforms.json must have a file_path, got {str(entry)[:40]}...")
    name, split, mask = entry["file_path"], entry.get("split"), entry.get("mask_path")
    if isinstance(mask, str):  # written by `livehand mask`; images may lie elsewhere, as a refined capture's do
        inner_path(Path(), mask)
    if split not in get_args(Split):
        raise LiveHandError(f"{name}: split must be one of {get_args(Split)}, got {split!r}")
    if not isinstance(mask, str | None):
        raise LiveHandError(f"{name}: mask_path must be a file's name, got {mask!r}")
    try:
        width, height = (int(n) for n in entry["size_px"])
        camera = Camera(np.array(entry["K"], float), np.array(entry["cam2world"], float), (width, height))
        view = CaptureView(name, camera, int(entry["camera_index"]), int(entry["pose_index"]), entry["split"], mask)
    except KeyError as error:
        raise LiveHandError(f"{name} must have a {error} in transforms.json, got none") from error
    except (ValueError, TypeError, OverflowError, LiveHandError) as error:
        raise LiveHandError(f"{name}: {error}") from error
    if not 0 <= view.pose_index < pose_count:
        raise LiveHandError(f"{name} must name one of {pose_count} poses, got {view.pose_index}")
    return view


def _read_lit_view(entry: dict | object, pose_count: int, light_count: int) -> CaptureView:
    """Read a view of version 2, which may have a light and an exposure."""
    view = _read_view(entry, pose_count)
    light, exposure = (entry.get("light"), entry.get("exposure", 1.0)) if isinstance(entry, dict) else (None, 1.0)
    is_index = isinstance(light, int) and not isinstance(light, bool) and 0 <= light < light_count
    if light is not None and not is_index:
        raise LiveHandError(f"{view.file}: light must be one of {light_count} lights, got {light!r}")
    if isinstance(exposure, bool) or not isinstance(exposure, float | int) or not 0 < exposure < np.inf:
        raise LiveHandError(f"{view.file}: exposure must be a finite number above 0, got {exposure!r}")
    return replace(view, light=light, exposure=float(exposure))


def _read_poses(path: Path) -> tuple[HandPose, ...]:
    try:
        arrays = read_npz(path)
        columns = ("theta", "beta", "transl", "side", *(["forearm"] if "forearm" in arrays else []))
        rows = list(zip(*(arrays[name] for name in columns), strict=True))
    except (LiveHandError, KeyError, ValueError, TypeError) as error:
        raise LiveHandError(f"{path} must hold theta, beta, transl and side of every pose ({error})") from error
    return read_all(path, ((read_pose, index, *row) for index, row in enumerate(rows)))


def read_pose(
    index: int, theta: np.ndarray, beta: np.ndarray, transl: np.ndarray, side: object, *forearm: np.ndarray
) -> HandPose:
    """Build the pose of a file's row, with or without a forearm.

    Raises:
        LiveHandError: with the row's index and its fault.
    """
    try:
        return HandPose(theta, beta, transl, _side(str(side)), *forearm)
    except (LiveHandError, TypeError) as error:
        raise LiveHandError(f"pose {index}: {error}") from error


def _side(name: str) -> Side:
    if name not in get_args(Side):
        raise LiveHandError(f"side must be 'right' or 'left', got {name!r}")
    return name  # type: ignore[return-value]


def _read_json(path: Path) -> dict:
    try:
        document = read_json(path)
    except LiveHandError as error:
        raise LiveHandError(
            f"{path} must be a capture's index ({error}); is {path.parent} a capture folder?"
        ) from error
    return document if isinstance(document, dict) else {}
