"""Hand models and renderers that stay loaded between frames, and are loaded again when their files change.

torch is imported at the first render. The registered render engine owns one session.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeVar

from ..hand.model import HandModel
from ..hand.model_file import load_hand_model
from ..records.errors import LiveHandError
from ..system.packages import load_torch_libraries
from ..system.thread_limits import allow_cpu_for_mps, limit_spinning
from .frame_queue import FrameQueue
from .frame_task import HandRenderer


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

    @property
    def avatar_paths(self) -> set[Path]:
        """The files of the avatars that are loaded."""
        return {key[0] for key in list(self._renderers)}  # threads add to them

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
