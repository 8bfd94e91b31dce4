"""How FFmpeg calls a camera on this system."""

from __future__ import annotations

import re
import sys
from typing import NamedTuple

from ..records.errors import LiveHandError

_FORMATS = {"linux": "v4l2", "darwin": "avfoundation", "win32": "dshow"}
_NAME = re.compile(r"[\w ().:#/-]+")


class CameraDevice(NamedTuple):
    """A camera: FFmpeg's name of it, and the input format that opens it."""

    url: str
    format: str


def camera_device(name: str) -> CameraDevice:
    """Find the camera of a number, as `0`, or of a name: a device file in Linux, its name in Windows and macOS.

    Raises:
        LiveHandError: it cannot be a camera's name.
    """
    if not _NAME.fullmatch(name):
        raise LiveHandError(f"a camera must be a number or a device's name, got {name!r}")
    if sys.platform == "win32":
        return CameraDevice(f"video={name}", _FORMATS[sys.platform])
    if sys.platform == "darwin":
        return CameraDevice(f"{name}:none", _FORMATS[sys.platform])
    return CameraDevice(f"/dev/video{name}" if name.isdecimal() else name, _FORMATS["linux"])
