"""What a caller hears while a frame is rendered."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

Stage = Literal["pose", "rasterise", "sample", "light", "field", "superres", "decode"]
OnStage = Callable[[Stage], None]


@dataclass(frozen=True)
class RenderHooks:
    """What a caller wants to hear while rays are rendered.

    Attributes:
        on_stage: called when a stage begins; the last stage ends with the frame.
        before_chunk: called before each chunk of rays; what it raises ends the render.
    """

    on_stage: OnStage = lambda stage: None
    before_chunk: Callable[[], None] = lambda: None
