"""Launches in a fixed order on fixed arrays: run one by one, or on a GPU recorded once and then started at once."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import warp as wp

_THREADS_OF_TILE = 128


class Sequence:
    """Launches on a device, whose arrays it keeps alive.

    Attributes:
        device: Warp's name of it.
        kernels: the names of the kernels, in order.
    """

    def __init__(self, device: str) -> None:
        self.device, self.kernels = device, list[str]()
        self._steps, self._kept = list[Callable[[], Any]](), list[Any]()
        self._graph = None

    def add(self, kernel: Any, dim: int | tuple[int, ...], *arguments: Any) -> None:
        """Add a launch; a launch for nothing is left out."""
        sizes = (dim,) if isinstance(dim, int) else dim
        if min(sizes) > 0:
            given = {"inputs": list(arguments), "device": self.device, "record_cmd": True}
            self._append(kernel, wp.launch(kernel, dim, **given), arguments)

    def add_tiles(self, kernel: Any, dim: tuple[int, ...], *arguments: Any) -> None:
        """Add a launch of a kernel of tiles."""
        given = {"inputs": list(arguments), "device": self.device, "record_cmd": True}
        self._append(kernel, wp.launch_tiled(kernel, dim, block_dim=_THREADS_OF_TILE, **given), arguments)

    def fill(self, words: wp.array, value: int) -> None:
        """Add the filling of an array with a number; zero, and -1, cost least."""
        self._steps.append((lambda: words.zero_()) if value == 0 else (lambda: words.fill_(value)))

    def then(self, step: Callable[[], None]) -> None:
        """Add a step that only starts work on the device."""
        self._steps.append(step)

    def run(self) -> None:
        """Start all; on a GPU from the second time on as one recorded graph. Nothing is waited for."""
        if self._graph is not None:
            wp.capture_launch(self._graph)
            return
        for step in self._steps:
            step()
        if wp.get_device(self.device).is_cuda:
            self._graph = self.recorded()

    def recorded(self) -> Any:
        """Record all as a graph, without running it."""
        with wp.ScopedCapture(device=self.device, force_module_load=False) as capture:
            for step in self._steps:
                step()
        return capture.graph

    def _append(self, kernel: Any, command: Any, arguments: tuple[Any, ...]) -> None:
        self.kernels.append(kernel.key)
        self._steps.append(command.launch)
        self._kept.append(arguments)
