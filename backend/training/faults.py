"""Steps that came to nothing because a loss or gradient was not finite."""

from __future__ import annotations

from ..records.errors import LiveHandError

_NAMED = 5


class FaultStreak:
    """Counts skipped steps, and ends training after too many in a row.

    Args:
        limit: how many.
    """

    def __init__(self, limit: int):
        self._limit = limit
        self._files: list[tuple[str, ...]] = []

    def note(self, faulty_files: tuple[str, ...]) -> None:
        """A step was taken, or skipped because of these images.

        Raises:
            LiveHandError: it was the last that may be skipped.
        """
        self._files = [*self._files, faulty_files] if faulty_files else []
        if len(self._files) < self._limit:
            return
        names = list(dict.fromkeys(name for files in self._files for name in files))
        shown = ", ".join(names[:_NAMED]) + (f" and {len(names) - _NAMED} more" if len(names) > _NAMED else "")
        raise LiveHandError(
            f"losses and gradients must be finite, got none in {self._limit} steps, with the images {shown}; look at "
            "their poses and cameras in the capture; if all images are concerned, try --precision fp32"
        )
