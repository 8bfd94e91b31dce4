"""The error for a missing optional package of this folder."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from ..records.errors import LiveHandError


@contextmanager
def needs(package: str) -> Iterator[None]:
    """Turn a failed import of `package` into a `LiveHandError` that names the command to install it."""
    try:
        yield
    except ImportError as error:
        raise LiveHandError(
            f"the built-in hand's detailed surface needs {package}, which is not installed ({error}); "
            "run: python -m pip install 'scipy>=1.11' 'scikit-image>=0.22'"
        ) from error
