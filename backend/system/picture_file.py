# pyright: basic
"""Opens image files in the formats that are named, of bounded size.

Pillow would otherwise try all of its formats on a file, some of which start other programs, whatever the name says.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from ..records.errors import LiveHandError
from .regular_file import MIB, check_regular

if TYPE_CHECKING:
    from PIL.Image import Image as Picture

FORMATS = ("PNG", "JPEG", "WEBP", "TIFF", "BMP")
MOST_PICTURE_BYTES = 1024 * MIB
MOST_PIXELS = 1 << 27
"""As many as 16384 x 8192."""


@contextmanager
def opened_picture(path: Path, formats: tuple[str, ...] = FORMATS) -> Iterator[Picture]:
    """An image whose header has been read and checked.

    Raises:
        LiveHandError: the file is missing, no regular file, of another format, damaged, or too large; also while its
            pixels are decoded in the context.
    """
    from PIL import Image

    try:
        check_regular(path, MOST_PICTURE_BYTES)
    except LiveHandError as error:
        raise LiveHandError(f"{path} must be a readable image ({error})") from error
    try:
        with Image.open(path, formats=formats) as picture:
            width, height = picture.size
            if width * height > MOST_PIXELS:
                raise LiveHandError(f"{path} must have at most {MOST_PIXELS} pixels, got {width} x {height}")
            yield picture
    except LiveHandError:
        raise
    except Exception as error:  # a damaged image can raise nearly anything
        raise LiveHandError(
            f"{path} must be a readable image ({', '.join(formats)}), got {type(error).__name__}: {error}"
        ) from error
