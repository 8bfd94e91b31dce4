"""The one error a user can mend: its message names the rule, what was got, and the remedy."""

from __future__ import annotations

from collections.abc import Sequence

_SHOWN = 10


class LiveHandError(Exception):
    """Bad input. Libraries raise it, commands print it and end with code 1, operators report it."""

    @classmethod
    def of_faults(cls, subject: str, faults: Sequence[str]) -> LiveHandError:
        """Join all that is wrong with the subject to one error: the first ten faults, and how many there are."""
        if len(faults) == 1:
            return cls(f"{subject}: {faults[0]}")
        more = [f"and {len(faults) - _SHOWN} more"] if len(faults) > _SHOWN else []
        return cls("\n  ".join([f"{subject} has {len(faults)} faults:", *faults[:_SHOWN], *more]))
