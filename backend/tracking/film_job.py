"""The hands of a video tracked and fitted in a process of its own, while Blender's window goes on."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..hand.model_file import DEFAULT_HAND, load_hand_model
from ..motion.landmarks.initial_pose import MirrorSigns
from ..motion.landmarks.take_file import FilmedTake, unmirrored
from ..motion.landmarks.take_fit import FilmCamera, TakeFit, fit_take
from ..motion.motion import HandMotion
from ..records.side import SIDES, Side
from ..system.child_job import ChildJob, JobProgress, Report, run_job
from .sighted_take import filmed_take, frames_of_film

if TYPE_CHECKING:
    from .video import VideoFrame

_FILM_MM = 36.0
_MOTION = ("theta", "beta", "transl", "forearm")
_FIT = ("is_keyed", "fit_error")


@dataclass(frozen=True)
class FilmRequest:
    """What is tracked, and the hands that are fitted.

    Attributes:
        source: a video; or a folder with its frames in order, as pictures.
        fps: of those frames; None: the video's.
        focal_mm: of the camera for a film 36 mm wide; 0: guessed.
        is_picture_mirrored: the video was mirrored, as selfies are.
        models: side -> file of the hand's model, "" for the built-in one; sides that are missing have that one, too.
        betas: side -> [10] shape of the hand; sides that are missing have the mean's.
        output: the file that the fits are written to (.npz).
    """

    source: str
    output: str
    fps: float | None = None
    focal_mm: float = 0.0
    is_picture_mirrored: bool = False
    models: Mapping[Side, str] | None = None
    betas: Mapping[Side, list[float]] | None = None


@dataclass(frozen=True)
class FilmFits:
    """The hands of a film, fitted.

    Attributes:
        camera: of the film.
        fps: of the film.
        count: frames of the film.
        fits: by side.
    """

    camera: FilmCamera
    fps: float
    count: int
    fits: Mapping[Side, TakeFit]


def start_film(request: FilmRequest) -> ChildJob:
    """Start the job; read its fits with `read_fits` after its end."""
    return ChildJob.start("tracking the hands", "tracking.film_job", asdict(request))


def run() -> None:
    """Track and fit the hands of a request."""
    run_job(_tracked_and_fitted, "the video needs more memory than is free; close other programs, or cut it into parts")


def _tracked_and_fitted(values: dict[str, Any], report: Report) -> Mapping[str, Any]:
    request = FilmRequest(**values)
    take = _tracked(request, report)
    if request.focal_mm:
        focal_px = request.focal_mm / _FILM_MM * take.camera.size_px[0]
        take = replace(take, camera=FilmCamera(take.camera.size_px, focal_px))
    if request.is_picture_mirrored:
        take = unmirrored(take)
    fits: dict[Side, TakeFit] = {}
    for side, hand in take.hands.items():
        report(JobProgress(f"fitting the {side} hand"))
        model = load_hand_model((request.models or {}).get(side) or DEFAULT_HAND).for_side(side)
        beta = (request.betas or {}).get(side)
        shape = None if beta is None else np.array(beta)
        fits[side] = fit_take(hand, take.times, take.camera, model, side, take.fps, shape)
    _write(FilmFits(take.camera, take.fps, len(take.times), fits), Path(request.output))
    return {"hands": list(fits)}


def _tracked(request: FilmRequest, report: Report) -> FilmedTake:
    from .takes import track_frames
    from .tracker import HandTracker
    from .video import open_video
    from .weights import load_networks

    source, tracker = Path(request.source), HandTracker(load_networks())
    if request.fps is None:
        video = open_video(source)
        fps, frames, count = video.fps, frames_of_film(video), video.count
    else:
        files = sorted(source.iterdir())
        fps, frames, count = request.fps, _pictures(files, request.fps), len(files)
    found = track_frames(_counted(frames, count, report), tracker)
    return filmed_take(found, fps, None, source)


def _pictures(files: list[Path], fps: float) -> Iterator[VideoFrame]:
    from PIL import Image

    from .video import VideoFrame

    for index, file in enumerate(files):
        with Image.open(file) as image:
            yield VideoFrame(index / fps, np.asarray(image.convert("RGB")))


def _counted(frames: Iterator[VideoFrame], count: int, report: Report) -> Iterator[VideoFrame]:
    for number, frame in enumerate(frames):
        of = f" of {count}" if count else ""
        report(JobProgress(f"frame {number + 1}{of}", number / count if count else None))
        yield frame


def _write(film: FilmFits, path: Path) -> None:
    arrays: dict[str, Any] = {"camera": (*film.camera.size_px, film.camera.focal_px, film.fps, film.count)}
    for side, fit in film.fits.items():
        arrays |= {f"{side}_{name}": getattr(fit.motion, name) for name in _MOTION}
        arrays |= {f"{side}_{name}": getattr(fit, name) for name in _FIT}
        arrays[f"{side}_numbers"] = (
            fit.motion.fps or film.fps,
            fit.start_s,
            fit.rejected,
            *fit.mirror,
        )
    np.savez(path, **arrays)


def read_fits(path: Path) -> FilmFits:
    """Read what a job has written, which nobody else writes."""
    with np.load(path, allow_pickle=False) as file:
        width, height, focal_px, film_fps, count = file["camera"].tolist()
        fits: dict[Side, TakeFit] = {}
        for side in SIDES:
            if f"{side}_theta" in file:
                fps, start_s, rejected, *mirror = file[f"{side}_numbers"].tolist()
                motion = HandMotion(**{name: file[f"{side}_{name}"] for name in _MOTION}, fps=fps, side=side)
                fits[side] = TakeFit(
                    motion,
                    start_s,
                    file[f"{side}_is_keyed"],
                    file[f"{side}_fit_error"],
                    int(rejected),
                    MirrorSigns(*mirror),
                )
    return FilmFits(FilmCamera((int(width), int(height)), focal_px), film_fps, int(count), fits)
