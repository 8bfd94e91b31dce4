"""The optional packages of this folder, and what to say where one is missing."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from ...records.errors import LiveHandError


@contextmanager
def needs(package: str) -> Iterator[None]:
    """Around an import of `package`: a missing one becomes a LiveHandError that names the command to run."""
    try:
        yield
    except ImportError as error:
        raise LiveHandError(
            f"the built-in hand's detailed surface needs {package}, which is not installed ({error}); "
            "run: python -m pip install 'scipy>=1.11' 'scikit-image>=0.22'"
        ) from error
