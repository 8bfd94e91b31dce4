"""What a caller hears of a frame that is being rendered, and how it stops it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from torch import Tensor

from ..records.render_hooks import OnStage, RenderHooks, Stage


class RenderStopped(Exception):
    """The caller's `should_stop` returned True."""


@dataclass(frozen=True)
class RenderProgress:
    """One render's caller.

    Attributes:
        should_stop: queried at every stage, and between chunks of rays and bands of super-resolution.
        on_stage: called when a stage begins; the last stage ends with the frame.
    """

    should_stop: Callable[[], bool] = lambda: False
    on_stage: OnStage = lambda stage: None

    def check(self) -> None:
        """Raise RenderStopped if the caller wants it."""
        if self.should_stop():
            raise RenderStopped

    def begin(self, stage: Stage) -> None:
        """Tell the caller that a stage begins, unless it wants to stop.

        Raises:
            RenderStopped: it does.
        """
        self.check()
        self.on_stage(stage)

    @property
    def of_rays(self) -> RenderHooks:
        """The same for the stages that a backend renders."""
        return RenderHooks(self.begin, self.check)

    def cancellable(self, network: Callable[[Tensor], Tensor]) -> Callable[[Tensor], Tensor]:
        """Return the network as one that may be stopped before each of its calls."""

        def run(maps: Tensor) -> Tensor:
            self.check()
            return network(maps)

        return run
