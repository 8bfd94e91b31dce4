"""Hand models and renderers that stay loaded between frames, and are loaded again when their files change.

Kernels are compiled ahead by small pictures that need every one of them; Blender does so in a process of its own.

torch is imported at the first render. The registered render engine owns one session.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeVar

from ..avatars.library import shipped_avatar_path
from ..hand.model import HandModel
from ..hand.model_file import load_hand_model
from ..records.errors import LiveHandError
from ..system.child_job import JobProgress, Report, run_job
from ..system.packages import load_torch_libraries
from ..system.thread_limits import allow_cpu_for_mps, limit_spinning
from .frame_queue import FrameQueue
from .frame_task import HandRenderer

if TYPE_CHECKING:
    from ..records.shot import Shot

_SIDE_PX = 64
_LOOK_S = 0.5


@dataclass(frozen=True)
class Device:
    """How a renderer computes, from the scene's `livehand` settings; see `render.renderer.Renderer`."""

    name: str = "auto"
    precision: Literal["fp32", "bf16"] = "fp32"
    has_skin_detail: bool = True


Item = TypeVar("Item")
RendererFactory = Callable[[Path, HandModel, Device], HandRenderer]


def load_renderer(avatar_path: Path, hand: HandModel, device: Device) -> HandRenderer:
    """Load the renderer of an avatar.

    Raises:
        LiveHandError: the avatar is unreadable or of another hand.
        ImportError: a package is missing.
    """
    limit_spinning()
    allow_cpu_for_mps()
    load_torch_libraries()
    from ..avatars.file import load_avatar
    from .renderer import Renderer

    avatar = load_avatar(avatar_path)
    return Renderer(
        avatar,
        hand,
        device=device.name,
        precision=device.precision,
        has_skin_detail=device.has_skin_detail,
    )


class Session:
    """Loads each hand model and renderer once, and again when its file changes.

    Args:
        make_renderer: loads a renderer that is not in the cache.

    Attributes:
        queue: renders the frames of the sequence that is being written; None at any other time.
        rendering: lock to hold while loading or rendering, as 3D views and stills use threads of their own.
    """

    def __init__(self, make_renderer: RendererFactory = load_renderer):
        self.queue: FrameQueue | None = None
        self.rendering = threading.Lock()
        self._make_renderer = make_renderer
        self._hands: dict[tuple, HandModel] = {}
        self._renderers: dict[tuple, HandRenderer] = {}

    def hand(self, path: Path) -> HandModel:
        """Return the hand model in a file, which serves both sides."""
        return _cached(self._hands, _file_key(path), lambda: load_hand_model(path))

    def renderer(self, avatar_path: Path, hand: HandModel, device: Device) -> HandRenderer:
        """Return the renderer of an avatar on a hand of this session."""
        key = (*_file_key(avatar_path), hand.sha256, device)
        return _cached(self._renderers, key, lambda: self._make_renderer(avatar_path, hand, device))

    def avatar_path(self, renderer: HandRenderer) -> Path:
        """Return the avatar file of a renderer of this session."""
        (key,) = (key for key, known in self._renderers.items() if known is renderer)
        return key[0]

    @contextlib.contextmanager
    def queueing(self) -> Iterator[FrameQueue]:
        """Enter a context in which the engine renders through a queue, which also renders the next frame in advance."""
        with FrameQueue() as self.queue:
            try:
                yield self.queue
            finally:
                self.queue = None

    def free(self) -> None:
        """Delete all renderers and hand models."""
        self._renderers.clear()
        self._hands.clear()


def _file_key(path: Path) -> tuple:
    """Return (path, modification time, size), so that a file that was overwritten is loaded again.

    Raises:
        LiveHandError: there is no such file.
    """
    try:
        stat = path.stat()
    except OSError as error:
        raise LiveHandError(
            f"no file at {path} ({error.strerror}); choose another in the LiveHand tab of the 3D view's sidebar"
        ) from error
    return (path, stat.st_mtime_ns, stat.st_size)


def _cached(cache: dict[tuple, Item], key: tuple, load: Callable[[], Item]) -> Item:
    """Return the cached item; loading one removes those of earlier versions of its file."""
    if key not in cache:
        for old in [old for old in cache if old[0] == key[0] and old[1:3] != key[1:3]]:
            del cache[old]
        cache[key] = load()
    return cache[key]


class Prepared(NamedTuple):
    """How long it took, s, and the folder that keeps the kernels; None: no folder takes them."""

    seconds: float
    folder: Path | None


def prepare_kernels(avatar_path: Path) -> Prepared:
    """Compile the kernels that render this avatar of the built-in hand; numba must be there.

    Raises:
        LiveHandError: the avatar cannot be read.
    """
    from ..avatars.file import load_avatar
    from ..compute.kernels.cache_folder import mark_prepared
    from ..hand.model_file import load_default_hand
    from .backends import kernel_cache
    from .renderer import Renderer

    began, avatar, hand = time.perf_counter(), load_avatar(avatar_path), load_default_hand()
    for precision in ("fp32", "bf16"):
        renderer = Renderer(avatar, hand, "cpu", precision)
        for shot in _shots(hand):
            renderer.render(shot)
    folder = kernel_cache()
    if folder is not None:
        mark_prepared(folder)
    return Prepared(time.perf_counter() - began, folder)


def _shots(hand: HandModel) -> list[Shot]:
    """Make small pictures that need every kernel: in the avatar's own light, and between lamp, sky and occluder."""
    import numpy as np

    from ..hand.lbs import posed_vertices
    from ..records.camera import Camera, look_at
    from ..records.light import Light
    from ..records.shot import HandPose, Shot
    from .studio_light import studio_light

    pose = HandPose(np.zeros((16, 3)), np.zeros(10), np.zeros(3), hand.side)
    vertices = posed_vertices(hand, pose)
    centre, size_m = vertices.mean(0), float(np.ptp(vertices, axis=0).max())
    K = np.array([[_SIDE_PX, 0, _SIDE_PX / 2], [0, _SIDE_PX, _SIDE_PX / 2], [0, 0, 1.0]])
    cam2world = look_at(centre + size_m * np.array([0, 1.5, 0.2]), centre, np.array([0, 0, 1.0]))
    shot = Shot(pose, vertices, Camera(K, cam2world, (_SIDE_PX, _SIDE_PX)))
    beside = centre + size_m * np.array([[2.0, 0, 0], [2, 0.1, 0], [2, 0, 0.1]])
    studio = studio_light()
    occluded = Light(studio.lamps, studio.sky, occluders=beside[None].astype(np.float32))
    return [shot, replace(shot, light=studio), replace(shot, light=occluded)]


def run() -> None:
    """Compile the kernels in the process of a job."""
    run_job(_prepared, "the kernels need more memory than is free; close other programs")


def _prepared(_request: None, report: Report) -> Mapping[str, Any]:
    threading.Thread(target=_count, args=(report,), name="livehand count", daemon=True).start()
    return {"seconds": prepare_kernels(shipped_avatar_path()).seconds}


def _count(report: Report) -> None:
    """Report how many kernels are compiled, until the process ends."""
    from ..compute.cpu import backend  # noqa: F401, which imports all kernels
    from ..compute.kernels.compiled import kernel_counts

    while True:
        compiled, every = kernel_counts()
        report(JobProgress(f"{compiled} of {every}", compiled / max(every, 1)))
        time.sleep(_LOOK_S)
