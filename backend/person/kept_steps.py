"""Results of the steps to a person, kept beside the output so that a run that was ended goes on where it was.

The folder `.NAME.person` holds a folder of each set of inputs, named by their digest: what was kept of others is
removed, and all of it when the avatar is written.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np

from ..batch.provenance import livehand_version
from ..motion.document import Document
from ..motion.landmarks.take_file import FilmedTake, read_take, write_take
from ..records.camera import Camera
from ..records.errors import LiveHandError
from ..records.hand_picture import HandPicture, PicturedHand
from ..records.shot import HandPose
from ..records.side import SIDES
from ..system.files import is_file, replacing
from ..system.readers import read_npz

VERSION = 1
"""Of what is kept: files of another version are made again."""
_CHUNK = 1 << 20
_MOST_BYTES = 2 << 30
_READ_WHOLE = 64 << 20  # larger files of a folder count by size and time

Result = TypeVar("Result")


class StepFormat(NamedTuple):
    """How a step's result is written to a file, and read."""

    write: Callable[[Any, Path], None]
    read: Callable[[Path], Any]


@dataclass(frozen=True)
class KeptSteps:
    """The steps of one run.

    Attributes:
        folder: of these inputs; None: nothing is kept.
    """

    folder: Path | None = None

    @classmethod
    def beside(cls, output: Path, inputs: Mapping[str, object]) -> KeptSteps:
        """Keep steps beside an output; those of other inputs are removed.

        Args:
            output: the avatar to be written.
            inputs: all that decides what the steps give, as JSON has it.
        """
        facts = json.dumps({**inputs, "livehand": livehand_version(), "version": VERSION}, sort_keys=True, default=str)
        parent = work_folder(output)
        folder = parent / hashlib.sha256(facts.encode()).hexdigest()[:16]
        if parent.is_dir():
            for other in parent.iterdir():
                if other != folder:
                    shutil.rmtree(other, ignore_errors=True)
        return cls(folder)

    def kept(self, name: str, make: Callable[[], Result], form: StepFormat) -> Result:
        """Read what a step gave before, or make and keep it.

        Args:
            name: of the step.
            make: does it.
            form: of its file.

        Raises:
            LiveHandError: the step fails, or there is no room to keep it.
        """
        if self.folder is None:
            return make()
        path = self.folder / f"{name}.npz"
        if is_file(path):
            with suppress(LiveHandError, KeyError, ValueError, TypeError):  # damaged: made again
                return form.read(path)
        result = make()
        form.write(result, path)
        with suppress(LiveHandError, KeyError, ValueError, TypeError):
            return form.read(path)  # the same to the last bit as for a run that goes on
        return result

    def remove(self) -> None:
        """Remove all that was kept."""
        if self.folder is not None:
            shutil.rmtree(self.folder, ignore_errors=True)
            with suppress(OSError):
                self.folder.parent.rmdir()


def work_folder(output: Path) -> Path:
    """Return the folder of the steps to an output."""
    return output.with_name(f".{output.stem}.person")


def remove_work(output: Path) -> None:
    """Remove what was kept of all inputs."""
    shutil.rmtree(work_folder(output), ignore_errors=True)


def digest_of(path: Path) -> str:
    """Compute the digest of a file, or of a folder's files; large ones of a folder count by size and time.

    Raises:
        LiveHandError: it cannot be read.
    """
    try:
        if not path.is_dir():
            return _digest_of_file(path)
        digest = hashlib.sha256()
        for file in sorted(each for each in path.rglob("*") if each.is_file()):
            status = file.stat()
            is_small = status.st_size <= _READ_WHOLE
            content = _digest_of_file(file) if is_small else f"{status.st_size} {status.st_mtime_ns}"
            digest.update(f"{file.relative_to(path)}\0{content}\0".encode(errors="surrogateescape"))
        return digest.hexdigest()
    except OSError as error:
        raise LiveHandError(f"{path} must be readable ({error}); check the path and its permissions") from error


def _digest_of_file(path: Path) -> str:
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while chunk := file.read(_CHUNK):
            digest.update(chunk)
    return digest.hexdigest()


def _write_arrays(arrays: Mapping[str, np.ndarray], path: Path) -> None:
    """Write arrays as they are: pictures hardly get smaller, and the file lives for minutes."""
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez(file, **arrays)  # pyright: ignore[reportArgumentType]


def _text(value: object) -> np.ndarray:
    return np.frombuffer(json.dumps(value).encode(), np.uint8)


def _value(array: np.ndarray) -> Any:
    return json.loads(array.tobytes())


def _write_hand(hand: PicturedHand, path: Path) -> None:
    facts: dict[str, Any] = {name: getattr(hand, name) for name in ("side", "source", "is_calibrated", "notes")}
    arrays = {} if hand.offset_m is None else {"offset_m": hand.offset_m}
    of_pictures = []
    for index, one in enumerate(hand.pictures):
        names = ("name", "camera_index", "scene", "log_gain", "is_held_out", "moment")
        of_pictures.append({name: getattr(one, name) for name in names})
        pose = {f"{index}/{name}": getattr(one.pose, name) for name in ("theta", "beta", "transl", "forearm")}
        arrays |= {f"{index}/rgb": one.rgb, f"{index}/labels": one.labels, **pose}
        arrays |= {f"{index}/K": one.camera.K, f"{index}/cam2world": one.camera.cam2world}
    _write_arrays({"facts": _text({**facts, "pictures": of_pictures}), **arrays}, path)


def _read_hand(path: Path) -> PicturedHand:
    arrays = read_npz(path, _MOST_BYTES)
    facts = _value(arrays["facts"])
    pictures = []
    for index, about in enumerate(facts["pictures"]):
        own = {name.partition("/")[2]: value for name, value in arrays.items() if name.startswith(f"{index}/")}
        height, width = own["rgb"].shape[:2]
        camera = Camera(own["K"], own["cam2world"], (width, height))
        pose = HandPose(own["theta"], own["beta"], own["transl"], "right", own["forearm"])
        gain = tuple(about.pop("log_gain"))
        pictures.append(
            HandPicture(rgb=own["rgb"], labels=own["labels"], camera=camera, pose=pose, log_gain=gain, **about)
        )
    side = SIDES[SIDES.index(facts["side"])]
    about_hand = facts["source"], arrays.get("offset_m"), facts["is_calibrated"], tuple(facts["notes"])
    return PicturedHand(tuple(pictures), side, *about_hand)


PICTURED_HAND = StepFormat(_write_hand, _read_hand)
"""Pictures with their masks, cameras and poses."""


class FittedRound(NamedTuple):
    """What an early round gives: the pictures' poses and cameras, the hand's own shape, and the melanin of its skin."""

    poses: tuple[HandPose, ...]
    cameras: tuple[Camera, ...]
    offset_m: np.ndarray | None
    melanin: float

    @classmethod
    def of(cls, hand: PicturedHand, melanin: float) -> FittedRound:
        """Keep what is new of a hand."""
        poses, cameras = zip(*((picture.pose, picture.camera) for picture in hand.pictures), strict=True)
        return cls(poses, cameras, hand.offset_m, melanin)

    def fitted(self, hand: PicturedHand) -> PicturedHand:
        """Give the pictures these poses and cameras, and the hand this shape."""
        rows = zip(hand.pictures, self.poses, self.cameras, strict=True)
        pictures = tuple(replace(picture, pose=pose, camera=camera) for picture, pose, camera in rows)
        return replace(hand, pictures=pictures, offset_m=self.offset_m)


_POSE, _CAMERA = ("theta", "beta", "transl", "forearm"), ("K", "cam2world", "size_px")


def _write_round(found: FittedRound, path: Path) -> None:
    arrays = {name: np.stack([getattr(pose, name) for pose in found.poses]) for name in _POSE}
    arrays |= {name: np.stack([getattr(camera, name) for camera in found.cameras]) for name in _CAMERA}
    arrays |= {} if found.offset_m is None else {"offset_m": found.offset_m}
    _write_arrays({**arrays, "melanin": np.array(found.melanin)}, path)


def _read_round(path: Path) -> FittedRound:
    arrays = read_npz(path)
    poses, cameras = (zip(*(arrays[name] for name in names), strict=True) for names in (_POSE, _CAMERA))
    return FittedRound(
        tuple(HandPose(theta, beta, transl, "right", forearm) for theta, beta, transl, forearm in poses),
        tuple(Camera(K, cam2world, (int(width), int(height))) for K, cam2world, (width, height) in cameras),
        arrays.get("offset_m"),
        arrays["melanin"].item(),
    )


FITTED_ROUND = StepFormat(_write_round, _read_round)
"""Poses, cameras and shape after a round of light, skin and flow."""


def _read_filmed_take(path: Path) -> FilmedTake:
    return read_take(Document(path, read_npz(path))).take


FILMED_TAKE = StepFormat(write_take, _read_filmed_take)
"""What the tracker saw in a film."""
