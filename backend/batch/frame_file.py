"""Checks that PNG and OpenEXR files are complete, without Blender, which opens half-written ones without complaint.

An EXR file consists of a magic number, version flags, headers of named attributes, a table of chunk offsets per part,
and the chunks. A chunk states its number of bytes; zip-compressed chunks, which we write, are decompressed as well.
Layout: https://openexr.com/en/latest/OpenEXRFileLayout.html
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

_EXR_MAGIC = 20000630
_MULTI_PART_FLAG = 0x1000
# Compression attribute -> rows per chunk; see the layout document.
_ROWS_PER_CHUNK = {0: 1, 1: 1, 2: 1, 3: 16, 4: 32, 5: 16, 6: 32, 7: 32, 8: 32, 9: 256}
_ZIP_COMPRESSIONS = (2, 3)
_BYTES_PER_SAMPLE = (4, 2, 4)  # uint, half, float

_PNG_END = b"\0\0\0\0IEND\xaeB`\x82"


class BrokenFrameError(Exception):
    """The file is empty, truncated, of another kind, or does not decode."""


@dataclass(frozen=True)
class ExrPart:
    """The header of one part; a single-part file has only one.

    Attributes:
        size_px: (width, height) of the data window.
        channels: name -> bytes per sample.
        compression: the attribute's value.
    """

    size_px: tuple[int, int]
    channels: dict[str, int]
    compression: int

    @property
    def chunk_count(self) -> int:
        """The number of chunks that hold the part's rows."""
        return -(-self.size_px[1] // _ROWS_PER_CHUNK[self.compression])

    def unpacked_size(self, chunk: int) -> int:
        """Return the size of a decompressed chunk, bytes; the last one may hold fewer rows."""
        rows = _ROWS_PER_CHUNK[self.compression]
        return min(rows, self.size_px[1] - chunk * rows) * self.size_px[0] * sum(self.channels.values())


def is_finished(path: Path, size_px: tuple[int, int]) -> bool:
    """Return whether a frame exists, decodes, and has this size."""
    try:
        check_frame(path, size_px)
    except (BrokenFrameError, OSError):
        return False
    return True


def check_frame(path: Path, size_px: tuple[int, int]) -> None:
    """Decode a frame file.

    Raises:
        BrokenFrameError: it is incomplete, or of another size.
        OSError: it cannot be read.
    """
    got = _png_size(path) if path.suffix == ".png" else _exr_size(path.read_bytes())
    if got != size_px:
        raise BrokenFrameError(f"{path.name} must be {size_px[0]} x {size_px[1]}, it is {got[0]} x {got[1]}")


def _png_size(path: Path) -> tuple[int, int]:
    from PIL import Image

    # Pillow accepts a missing end. A complete file ends with an empty IEND chunk: length, name, checksum.
    if path.read_bytes()[-12:] != _PNG_END:
        raise BrokenFrameError(f"{path.name} is cut short")
    try:
        with Image.open(path, formats=("PNG",)) as image:
            image.load()
            return image.size
    except Exception as error:  # a damaged picture can raise nearly anything
        raise BrokenFrameError(f"{path.name} does not decode: {error}") from error


def _exr_size(data: bytes) -> tuple[int, int]:
    try:
        parts, position = read_exr_header(data)
        for number, part in enumerate(parts):
            offsets = struct.unpack_from(f"<{part.chunk_count}Q", data, position)
            position += 8 * part.chunk_count
            for chunk, offset in enumerate(offsets):
                _check_chunk(data, offset, part, chunk, number if len(parts) > 1 else None)
    except (struct.error, zlib.error, IndexError, KeyError, ValueError, UnicodeDecodeError) as error:
        raise BrokenFrameError(f"the EXR does not decode: {error}") from error
    return parts[0].size_px


def _check_chunk(data: bytes, offset: int, part: ExrPart, chunk: int, part_number: int | None) -> None:
    """Raise ValueError, zlib.error or struct.error if a chunk of scan lines is incomplete."""
    if part_number is not None:
        (got,) = struct.unpack_from("<i", data, offset)
        if got != part_number:
            raise ValueError(f"chunk {chunk} belongs to part {got}, not {part_number}")
        offset += 4
    _, packed_size = struct.unpack_from("<ii", data, offset)
    packed = data[offset + 8 : offset + 8 + packed_size]
    if packed_size <= 0 or len(packed) != packed_size:
        raise ValueError(f"chunk {chunk} is cut short")
    expected = part.unpacked_size(chunk)
    is_packed = part.compression in _ZIP_COMPRESSIONS and packed_size < expected
    if is_packed and len(zlib.decompress(packed)) != expected:
        raise ValueError(f"chunk {chunk} does not hold {expected} bytes")


def read_exr_header(data: bytes) -> tuple[list[ExrPart], int]:
    """Read all parts, and the position of the first chunk table.

    Raises:
        ValueError: it is not a scan-line EXR.
    """
    magic, version = struct.unpack_from("<ii", data)
    if magic != _EXR_MAGIC:
        raise ValueError("not an EXR file")
    part, position = _read_part(data, 8)
    parts = [part]
    while version & _MULTI_PART_FLAG and data[position] != 0:
        part, position = _read_part(data, position)
        parts.append(part)
    return parts, position + bool(version & _MULTI_PART_FLAG)


def _read_part(data: bytes, position: int) -> tuple[ExrPart, int]:
    attributes: dict[str, Any] = {}
    while data[position] != 0:
        name, position = _read_text(data, position)
        _, position = _read_text(data, position)
        (size,) = struct.unpack_from("<i", data, position)
        attributes[name] = data[position + 4 : position + 4 + size]
        position += 4 + size
    x0, y0, x1, y1 = struct.unpack("<4i", attributes["dataWindow"])
    channels = _read_channels(attributes["channels"])
    return ExrPart((x1 - x0 + 1, y1 - y0 + 1), channels, attributes["compression"][0]), position + 1


def _read_channels(data: bytes) -> dict[str, int]:
    channels, position = {}, 0
    while data[position] != 0:
        name, position = _read_text(data, position)
        (kind,) = struct.unpack_from("<i", data, position)
        channels[name] = _BYTES_PER_SAMPLE[kind]
        position += 16
    return channels


def _read_text(data: bytes, position: int) -> tuple[str, int]:
    end = data.index(0, position)
    return data[position:end].decode(), end + 1
