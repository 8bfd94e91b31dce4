"""A folder of photographs of a hand as pictures of a person: any order, any cameras, a light each."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import hypot, radians, tan
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import ExifTags, Image, ImageOps

from ..capture.masks.mask import load_opencv
from ..hand.lbs import posed_vertices
from ..hand.model import HandModel
from ..motion.landmarks.take_file import FilmedTake
from ..motion.landmarks.take_fit import FilmCamera, FilmedHand
from ..motion.spaces import to_blender
from ..records.camera import Camera
from ..records.errors import LiveHandError
from ..records.hand_picture import HandPicture, PicturedHand
from ..records.side import SIDES, Side
from ..tracking.turning_hand.coverage import covered_share
from ..tracking.turning_hand.hand_frames import hand_frames
from ..tracking.turning_hand.take_shape import fit_with_shape
from ..tracking.turning_hand.window import camera_of, image_of, window_around
from .film import LONGEST_PX, USUAL_FOV_DEG, Progress, check_one_person, is_held_out, unseen_note
from .other_hands import in_window
from .skin_masks import labelled

if TYPE_CHECKING:
    from ..tracking.tracked_hand import TrackedHand
    from ..tracking.weights import TrackerNetworks

SUFFIXES = (".jpg", ".jpeg", ".png", ".webp", ".tif", ".tiff", ".heic", ".heif")
_FILM_DIAGONAL_MM = hypot(36, 24)
_MM_OF_UNIT = {2: 25.4, 3: 10.0}  # of EXIF's focal plane resolution
_FOCAL_RANGE = (0.3, 20.0)  # times the longer side
_LARGEST_PX = 1 << 27
_WRONG_SIDE = 0.3  # how surely a hand is the other one
_SHARED_FOCAL_PX, _SHARED_SIZE_PX = 1000.0, (20000, 20000)  # of the camera in which all are fitted


@dataclass(frozen=True)
class Photograph:
    """A photograph, upright.

    Attributes:
        name: of the file.
        rgb: uint8 [H, W, 3], sRGB.
        focal_px: focal length.
        is_guessed: the file does not tell the focal length.
    """

    name: str
    rgb: np.ndarray
    focal_px: float
    is_guessed: bool


@dataclass(frozen=True)
class _Shown:
    """A photograph, the person's hand in it, and other hands."""

    photograph: Photograph
    hand: TrackedHand
    others: tuple[TrackedHand, ...]


def pictures_of_photographs(
    folder: Path,
    model: HandModel,
    progress: Progress,
    side: Side | None = None,
    networks: TrackerNetworks | None = None,
    fov_deg: float | None = None,
) -> PicturedHand:
    """Find the hand in all photographs of a folder and fit one shape to it.

    Args:
        folder: of photographs of one hand of one person; what is no picture in it is passed over.
        model: the built-in hand.
        progress: is told what begins.
        side: of the hand; None: the likelier one.
        networks: the tracker's; None: the user's own.
        fov_deg: angle of view along the longer side of photographs that do not tell it; None: a usual one.

    Raises:
        LiveHandError: there are no pictures, none shows a hand, most show several people, or nothing has the colour of
            skin. Single pictures that cannot be used become notes.
    """
    from ..tracking.still import StillTracker
    from ..tracking.weights import load_networks

    load_opencv()
    tracker, right = StillTracker(networks or load_networks()), model.for_side("right")
    progress("reading the photographs")
    photographs, notes = read_photographs(folder, fov_deg or USUAL_FOV_DEG)
    progress(f"looking for the hand in {len(photographs)} photographs")
    found = [tracker.hands(photograph.rgb) for photograph in photographs]
    check_one_person(folder, found)
    chosen_side = side or _likelier_side(found)
    shown = []
    for photograph, hands in zip(photographs, found, strict=True):
        hand = _hand_of(hands, chosen_side)
        if hand is None:
            notes.append(f"{photograph.name} shows no {chosen_side} hand and is left out")
        else:
            shown.append(_Shown(photograph, hand, tuple(each for each in hands if each is not hand)))
    if not shown:
        raise LiveHandError(
            f"{folder} must show a hand, got none in {len(photographs)} photographs; photograph the whole hand in light"
        )
    progress(f"fitting the {chosen_side} hand")
    take = _as_take(shown, chosen_side)
    seen = hand_frames(take, chosen_side, fit_with_shape(take, chosen_side, model), right)
    notes += [
        f"{one.photograph.name}: no pose of a hand explains it, and it is left out"
        for index, one in enumerate(shown)
        if index not in seen.frames
    ]
    shown = [shown[index] for index in seen.frames]
    poses = [seen.motion.pose(index) for index in range(len(shown))]
    images, cameras, others_px = [], [], []
    for one, pose in zip(shown, poses, strict=True):
        camera = _camera(one.photograph)
        px, _ = camera.project(posed_vertices(right, pose)[right.framed_vertices])
        window = window_around(px, camera.size_px, LONGEST_PX)
        rgb = one.photograph.rgb[:, ::-1] if chosen_side == "left" else one.photograph.rgb
        images.append(np.ascontiguousarray(image_of(rgb, window)))
        cameras.append(camera_of(camera, window))
        others_px.append([in_window(_shown_px(each, one, chosen_side), camera, cameras[-1]) for each in one.others])
    progress(f"masking {len(poses)} pictures")
    labels = labelled(images, poses, cameras, right, others_px)
    pictures = tuple(
        HandPicture(one.photograph.name, image, label, camera, pose, index, index, is_held_out(index, len(poses)))
        for index, (one, image, label, camera, pose) in enumerate(
            zip(shown, images, labels, cameras, poses, strict=True)
        )
    )
    notes += [] if fov_deg else _guessed_note(shown)
    notes += [note for note in (unseen_note(covered_share(poses, cameras, right)),) if note]
    return PicturedHand(pictures, chosen_side, folder.name, notes=tuple(notes))


def read_photographs(folder: Path, fov_deg: float = USUAL_FOV_DEG) -> tuple[list[Photograph], list[str]]:
    """Read the pictures of a folder by name, and note those that cannot be read.

    Raises:
        LiveHandError: there is no such folder, or no picture in it.
    """
    if not folder.is_dir():
        raise LiveHandError(f"photographs must lie in a folder, got {folder}, which is none")
    files = sorted(path for path in folder.iterdir() if path.is_file() and path.suffix.lower() in SUFFIXES)
    photographs, notes = [], []
    for path in files:
        try:
            photographs.append(read_photograph(path, fov_deg))
        except LiveHandError as error:
            notes.append(str(error))
    if not photographs:
        reason = notes[0] if notes else "it has no JPEG, PNG or HEIC file"
        raise LiveHandError(f"{folder} must hold photographs, got none that can be read: {reason}")
    return photographs, notes


def read_photograph(path: Path, fov_deg: float = USUAL_FOV_DEG) -> Photograph:
    """Read a picture upright, with the focal length that its EXIF tells, or else of this angle along its longer side.

    Raises:
        LiveHandError: it cannot be read.
    """
    try:
        with Image.open(path) as file:
            if file.width * file.height > _LARGEST_PX:
                raise LiveHandError(f"{path.name} is too large ({file.width} x {file.height}); reduce it")
            focal_px = _exif_focal_px(file)
            rgb = np.asarray(ImageOps.exif_transpose(file).convert("RGB"))
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError, Image.DecompressionBombWarning) as error:
        raise LiveHandError(
            f"{path.name} cannot be read ({type(error).__name__}) and is left out; save it as JPEG or PNG"
        ) from error
    usual_px = max(rgb.shape[:2]) / 2 / tan(radians(fov_deg) / 2)
    return Photograph(path.name, rgb, focal_px or usual_px, focal_px is None)


def _exif_focal_px(file: Image.Image) -> float | None:
    """Compute the focal length from the 35 mm equivalent, over the diagonal, or from the focal plane's resolution."""
    exif = file.getexif().get_ifd(ExifTags.IFD.Exif)
    equivalent_mm = _number(exif, ExifTags.Base.FocalLengthIn35mmFilm)
    focal_mm, per_unit = (
        _number(exif, tag) for tag in (ExifTags.Base.FocalLength, ExifTags.Base.FocalPlaneXResolution)
    )
    unit_mm = _MM_OF_UNIT.get(int(_number(exif, ExifTags.Base.FocalPlaneResolutionUnit) or 2), 25.4)
    taken_px = _number(exif, ExifTags.Base.ExifImageWidth) or file.width
    focal_px = None
    if equivalent_mm:
        focal_px = equivalent_mm / _FILM_DIAGONAL_MM * hypot(file.width, file.height)
    elif focal_mm and per_unit:
        focal_px = focal_mm / unit_mm * per_unit * file.width / taken_px
    low, high = (share * max(file.size) for share in _FOCAL_RANGE)
    return focal_px if focal_px and low <= focal_px <= high else None


def _number(exif: Any, tag: int) -> float | None:
    try:
        value = float(exif.get(tag))
    except (TypeError, ValueError, ZeroDivisionError):
        return None
    return value if np.isfinite(value) and value > 0 else None


def _likelier_side(found: Sequence[Sequence[TrackedHand]]) -> Side:
    """Choose the side of the largest hands, which more photographs are of."""
    largest = [max(hands, key=_size_px) for hands in found if hands]
    return "right" if np.mean([hand.right for hand in largest] or [1.0]) > 0.5 else "left"


def _hand_of(hands: Iterable[TrackedHand], side: Side) -> TrackedHand | None:
    """Choose the hand of a side, the largest of several; None if all are surely of the other."""
    sureness = {hand.track: hand.right if side == SIDES[0] else 1 - hand.right for hand in hands}
    fitting = [hand for hand in hands if sureness[hand.track] >= _WRONG_SIDE]
    likely = [hand for hand in fitting if sureness[hand.track] >= 0.5]
    return max(likely or fitting, key=_size_px, default=None)


def _size_px(hand: TrackedHand) -> float:
    return float(np.ptp(hand.px, axis=0).max())


def _as_take(shown: Sequence[_Shown], side: Side) -> FilmedTake:
    """Put the photographs into one camera as moments a second apart, which a fit does not connect."""
    px = np.stack(
        [
            (one.hand.px - np.array(one.photograph.rgb.shape[1::-1]) / 2) * (_SHARED_FOCAL_PX / one.photograph.focal_px)
            for one in shown
        ]
    )
    world = np.stack([one.hand.world for one in shown])
    hand = FilmedHand(np.arange(len(shown)), px + np.array(_SHARED_SIZE_PX) / 2, world)
    return FilmedTake(FilmCamera(_SHARED_SIZE_PX, _SHARED_FOCAL_PX), np.arange(len(shown)) * 1.0, 1.0, {side: hand})


def _shown_px(hand: TrackedHand, shown: _Shown, side: Side) -> np.ndarray:
    """Return a hand's landmarks [21, 2] in the photograph as it becomes a picture: a left hand's is mirrored."""
    width = shown.photograph.rgb.shape[1]
    return hand.px if side == "right" else np.array([width, 0]) + hand.px * [-1, 1]


def _camera(photograph: Photograph) -> Camera:
    height, width = photograph.rgb.shape[:2]
    focal_px = photograph.focal_px
    K = np.array([[focal_px, 0, width / 2], [0, focal_px, height / 2], [0, 0, 1.0]])
    return Camera(K, to_blender("opencv"), (width, height))


def _guessed_note(shown: Sequence[_Shown]) -> list[str]:
    guessed = [one.photograph.name for one in shown if one.photograph.is_guessed]
    if not guessed:
        return []
    return [f"{len(guessed)} photographs do not tell their focal length; {USUAL_FOV_DEG:g} degrees are taken"]
