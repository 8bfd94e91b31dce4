"""How fast a hand before a camera is followed: a file plays as the camera, its hand is tracked, fitted and rendered.

    python examples/live_rate.py [FILM.mp4]      # without a film, one of our own hand is made first, 1280 x 720

The tracker has a core, and so has the renderer; the fit is on either. For that, set
GOMP_SPINCOUNT=0 OMP_NUM_THREADS=1 NUMBA_NUM_THREADS=1 before it.

Prints the rate, and the time from a frame's arrival to the avatar's picture of the same pose. Needs PyAV and the
tracker's networks (`livehand fetch-tracker`).
"""

import argparse
import tempfile
import threading
import time
from pathlib import Path

import numpy as np
from livehand.backend.avatars.file import load_avatar
from livehand.backend.avatars.library import shipped_avatar_path
from livehand.backend.hand.lbs import posed_vertices
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.motion.landmarks.online_fit import OnlineFit
from livehand.backend.motion.landmarks.take_fit import FilmCamera
from livehand.backend.records.camera import Camera
from livehand.backend.records.light import Light, Sky
from livehand.backend.records.shot import HandPose, Shot
from livehand.backend.render.renderer import Renderer
from livehand.backend.research.takes import made_take, pictures
from livehand.backend.tracking.live import CameraSource, LiveTracker
from livehand.backend.tracking.video_writer import write_video

HAND, FILM_PX, FRAMES, SHOWN_PX = load_default_hand(), (1280, 720), 240, 284 * 160
LIGHT, RNG = Light((), Sky(np.ones((2, 4, 3))), shadow_quality="none"), np.random.default_rng(0)


def made_film(path: Path, renderer: Renderer) -> None:
    rng = np.random.default_rng(5)
    take = made_take(rng, HAND, "mixes", "palm", frames=FRAMES, size_px=FILM_PX)
    write_video(pictures(take, renderer, rng), path, np.arange(FRAMES) / 30, 30.0)


def warm_up(renderer: Renderer) -> None:
    """What the first pictures prepare."""
    for picture in pictures(made_take(np.random.default_rng(1), HAND, "mixes", "palm", frames=3), renderer, RNG):
        assert picture.any()


class Fitting:
    """A thread that fits the newest frame's hand and poses the mesh, while the last is rendered, as in Blender."""

    def __init__(self, tracker: LiveTracker):
        self._tracker, self._arrived = tracker, threading.Condition()
        self._newest: tuple[Shot, float] | None = None
        self._has_ended = False
        threading.Thread(target=self._run, daemon=True).start()

    def newest(self) -> tuple[Shot, float] | None:
        """The newest shot, and when its frame was taken; None at the end."""
        with self._arrived:
            self._arrived.wait_for(lambda: self._newest or self._has_ended)
            newest, self._newest = self._newest, None
            return newest

    def _run(self) -> None:
        try:
            self._follow()
        finally:
            self._give(None)

    def _follow(self) -> None:
        fits: dict[int, OnlineFit] = {}
        while not self._tracker.has_ended:
            frame = self._tracker.newest(wait_s=1.0)
            if frame is None:
                continue
            for hand in frame.hands:
                guessed = FilmCamera.guessed(frame.size_px)
                if hand.track not in fits:
                    fits[hand.track] = OnlineFit(guessed, HAND, "right" if hand.right > 0.5 else "left")
                seen = fits[hand.track].follow(frame.time_s, hand.px, hand.world)
                if seen is not None:
                    self._give((shot_of(seen.pose, guessed), frame.taken_s))

    def _give(self, newest: tuple[Shot, float] | None) -> None:
        with self._arrived:
            self._newest, self._has_ended = newest or self._newest, newest is None
            self._arrived.notify()


def shot_of(pose: HandPose, film: FilmCamera) -> Shot:
    """A shot in a preview's quality, as a Rendered viewport has it while something moves."""
    share = (SHOWN_PX / np.prod(film.size_px)) ** 0.5
    width, height = (round(share * side) for side in film.size_px)
    focal_px = share * film.focal_px
    K = np.array([[focal_px, 0, width / 2], [0, focal_px, height / 2], [0, 0, 1]])
    vertices = posed_vertices(HAND.for_side(pose.side), pose)
    return Shot(pose, vertices, Camera(K, np.eye(4), (width, height)), LIGHT, quality="preview")


def measure(film: Path, renderer: Renderer) -> None:
    tracker, waits_ms, times_s = LiveTracker(CameraSource(str(film), is_file=True), 1), [], []
    began, own_s = time.monotonic(), time.process_time()
    fitting = Fitting(tracker)
    while (newest := fitting.newest()) is not None:
        shot, taken_s = newest
        renderer.render(shot)
        times_s.append(time.monotonic())
        waits_ms.append(1000 * (times_s[-1] - taken_s))
    busy = (time.process_time() - own_s) / (time.monotonic() - began)
    tracker.close()
    late = len(times_s) // 4  # what the first frames prepare is no rate
    rate = (len(times_s) - late - 1) / (times_s[-1] - times_s[late])
    low, middle, high = np.percentile(waits_ms[late:], [10, 50, 90])
    print(f"{len(times_s)} frames shown, {rate:.1f} a second; {middle:.0f} ms each ({low:.0f} to {high:.0f})")
    print(f"{1000 * busy / rate:.0f} ms of processor time a frame without the tracker's")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("film", type=Path, nargs="?")
    parser.add_argument("--precision", choices=("fp32", "bf16"), default="bf16")
    args = parser.parse_args()
    avatar = load_avatar(shipped_avatar_path("light"))
    renderer = Renderer(avatar, HAND, "cpu", precision=args.precision)
    with tempfile.TemporaryDirectory() as folder:
        film = args.film or Path(folder) / "film.mp4"
        if args.film is None:
            made_film(film, renderer)
        warm_up(renderer)
        measure(film, renderer)
