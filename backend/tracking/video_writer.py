"""Writes pictures as a video, with the times of the footage they come from."""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path

import numpy as np

from ..records.errors import LiveHandError
from ..system.files import replacing
from .video import import_av

_TIME_BASE = Fraction(1, 90_000)
_QUALITY = "18"


def write_video(pictures: Iterable[np.ndarray], path: Path, times: np.ndarray, fps: float) -> int:
    """Write uint8 pictures [H, W, 3] as H.264, atomically; an odd side loses its last pixel. Returns their number.

    Raises:
        LiveHandError: PyAV is missing or cannot write the file.
    """
    av, count = import_av(), 0
    try:
        with replacing(path) as temporary, av.open(str(temporary), "w") as container:
            stream = None
            for picture, time_s in zip(pictures, times, strict=False):
                even = np.ascontiguousarray(picture[: len(picture) // 2 * 2, : picture.shape[1] // 2 * 2])
                if stream is None:
                    stream = container.add_stream("libx264", rate=Fraction(fps).limit_denominator(1001))
                    stream.height, stream.width = even.shape[:2]
                    stream.pix_fmt, stream.options = "yuv420p", {"crf": _QUALITY}
                    stream.codec_context.time_base = _TIME_BASE
                frame = av.VideoFrame.from_ndarray(even, format="rgb24")
                frame.pts, frame.time_base = round(float(time_s) / _TIME_BASE), _TIME_BASE
                container.mux(stream.encode(frame))
                count += 1
            if stream is not None:
                container.mux(stream.encode(None))
    except av.error.FFmpegError as error:
        raise LiveHandError(f"{path} cannot be written as a video ({error}); give a folder for pictures") from error
    return count
