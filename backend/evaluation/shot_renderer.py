"""All that an evaluation knows of what it measures: something that renders the shots of a hand model."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from ..hand.model import HandModel
from ..records.frame import Frame
from ..records.render_hooks import OnStage
from ..records.shot import Shot


def no_stage(stage: str) -> None:
    """Ignore the stages of a frame."""


@runtime_checkable
class ShotRenderer(Protocol):
    """Renders hands of one model: an avatar's renderer, or one of another method."""

    @property
    def hand(self) -> HandModel:
        """The model of the shots' meshes."""
        ...

    def render(self, shot: Shot, *, on_stage: OnStage = no_stage) -> Frame:
        """Render a frame of the shot's size; `on_stage` is called when a stage begins."""
        ...
