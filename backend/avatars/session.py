"""What stays loaded between frames: hand models and renderers, keyed on the content of their files.

torch is imported on the first render, not before. One session belongs to the registered render engine.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from ..hand.model import HandModel
from ..hand.model_file import load_default_hand, load_hand_model
from ..records.errors import LiveHandError
from ..rendering.frame_queue import FrameQueue
from ..rendering.frame_task import HandRenderer
from ..runtime.thread_limits import limit_spinning
from .library import shipped_avatar_path


@dataclass(frozen=True)
class Device:
    """Where and how exactly to compute: the scene's `livehand` settings."""

    name: str = "auto"
    precision: Literal["fp32", "bf16"] = "fp32"


RendererFactory = Callable[[Path | None, HandModel, Device], HandRenderer]


def load_renderer(avatar_path: Path | None, hand: HandModel, device: Device) -> HandRenderer:
    """The renderer of one avatar.

    Raises:
        LiveHandError: the avatar is unreadable or of another hand.
        ImportError: a package is missing.
    """
    limit_spinning()
    from ..rendering.renderer import Renderer
    from .file import load_avatar

    return Renderer(load_avatar(avatar_path), hand, device=device.name, precision=device.precision)


class Session:
    """Loads each hand model and renderer once, and again when its file changes.

    Attributes:
        queue: renders the frames of the sequence that is being written; None at any other time.
        rendering: held by whoever loads or renders: 3D views and a still do so in threads of their own.
    """

    def __init__(self, make_renderer: RendererFactory = load_renderer):
        self.queue: FrameQueue | None = None
        self.rendering = threading.Lock()
        self._make_renderer = make_renderer
        self._hands: dict[Any, HandModel] = {}
        self._renderers: dict[Any, HandRenderer] = {}

    def hand(self, path: Path | None) -> HandModel:
        """The hand model in `path`; None is the built-in hand. It stands for either side."""
        key = _content_key(path)
        if key not in self._hands:
            _forget_old(self._hands, key)
            self._hands[key] = load_default_hand() if path is None else load_hand_model(path)
        return self._hands[key]

    def renderer(self, avatar_path: Path | None, hand: HandModel, device: Device) -> HandRenderer:
        """The renderer of an avatar (None: the shipped one) on a hand from this session."""
        key = (*_content_key(avatar_path), hand.sha256, device)
        if key not in self._renderers:
            _forget_old(self._renderers, key)
            self._renderers[key] = self._make_renderer(avatar_path, hand, device)
        return self._renderers[key]

    def avatar_path(self, renderer: HandRenderer) -> Path:
        """The file that a renderer of this session was made from."""
        (key,) = (key for key, known in self._renderers.items() if known is renderer)
        return key[0] or shipped_avatar_path()

    @contextlib.contextmanager
    def queueing(self) -> Iterator[FrameQueue]:
        """Within, the engine renders through a queue, the next frame included."""
        with FrameQueue() as self.queue:
            try:
                yield self.queue
            finally:
                self.queue = None

    def free(self) -> None:
        """Give the memory of all renderers and hands back."""
        self._renderers.clear()
        self._hands.clear()


def _content_key(path: Path | None) -> tuple:
    """(path, when it changed, size): a file that is trained over must not be served from memory.

    Raises:
        LiveHandError: there is no such file.
    """
    if path is None:
        return (None, 0, 0)
    try:
        stat = path.stat()
    except OSError as error:
        raise LiveHandError(f"no file at {path} ({error.strerror}); choose another in the hand's properties") from error
    return (path, stat.st_mtime_ns, stat.st_size)


def _forget_old(cache: dict[Any, Any], key: tuple) -> None:
    """Drop what was loaded from the same path when the file was another one."""
    for old in [old for old in cache if old[0] == key[0] and old[1:3] != key[1:3]]:
        del cache[old]
