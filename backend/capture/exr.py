"""OpenEXR files of scan lines in half or full floats: the kind that scene-linear captures and skies consist of."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..records.errors import LiveHandError
from ..system.files import MIB, read_regular, replacing

_MAGIC = 20000630
_VERSION, _TILED, _DEEP, _PARTS = 2, 0x200, 0x800, 0x1000
_TYPES = (np.dtype("<u4"), np.dtype("<f2"), np.dtype("<f4"))
_COMPRESSIONS = ("none", "RLE", "ZIPS", "ZIP", "PIZ", "PXR24", "B44", "B44A", "DWAA", "DWAB")
_LINES_OF = {"none": 1, "ZIPS": 1, "ZIP": 16}  # scan lines in a block
_MOST_PIXELS = 1 << 26  # 8192 x 8192
_MOST_BYTES = 1024 * MIB
_ZIP_LEVEL = 4
# What damaged bytes lead to while they are taken apart.
_DAMAGE = (struct.error, IndexError, KeyError, ValueError, UnicodeDecodeError, zlib.error, OverflowError, MemoryError)


@dataclass(frozen=True)
class _Header:
    """What is needed of a file's header; boxes are (x0, y0, x1, y1) px, the last ones included."""

    channels: tuple[tuple[str, np.dtype], ...]
    compression: str
    data_box: tuple[int, int, int, int]
    display_box: tuple[int, int, int, int]
    size: int

    @property
    def size_px(self) -> tuple[int, int]:
        """(width, height) of the whole picture."""
        return _box_size(self.display_box)


def read_exr(path: Path) -> dict[str, np.ndarray]:
    """Read the channels [H, W] of a picture by name, float16 or float32 as in the file; 0 where the file has no data.

    Raises:
        LiveHandError: missing, damaged, or of another kind: tiles, several parts, subsampled, other compressions.
    """
    data = _bytes_of(path)
    header = _checked_header(path, data)
    try:
        return _channels_of(data, header)
    except _DAMAGE as error:
        raise LiveHandError(f"{path} must be a whole OpenEXR file ({error})") from error


def read_exr_header(path: Path) -> tuple[tuple[str, ...], tuple[int, int]]:
    """Read the names of the channels, and (width, height) px.

    Raises:
        LiveHandError: as `read_exr`, but for damage after the header.
    """
    header = _checked_header(path, _bytes_of(path))
    return tuple(name for name, _ in header.channels), header.size_px


def write_exr(path: Path, channels: dict[str, np.ndarray], text: Mapping[str, str] | None = None) -> None:
    """Write channels [H, W], float16 or float32, compressed without loss, under a temporary name first.

    Args:
        path: of the file.
        channels: by name.
        text: more attributes of the header.

    Raises:
        LiveHandError: the file cannot be written.
    """
    with replacing(path) as temporary:
        temporary.write_bytes(_file_of(channels, text or {}))


def _bytes_of(path: Path) -> bytes:
    try:
        return read_regular(path, _MOST_BYTES)
    except LiveHandError as error:
        raise LiveHandError(f"{path} must be a readable image ({error})") from error


def _checked_header(path: Path, data: bytes) -> _Header:
    try:
        magic, version = struct.unpack_from("<II", data)
        if magic != _MAGIC or version & 0xFF != _VERSION:
            raise ValueError("its first bytes are not OpenEXR's")
        if version & (_TILED | _DEEP | _PARTS):
            raise ValueError("it has tiles, several parts or deep pixels; save it as one part of scan lines")
        header = _read_header(data)
        if header.compression not in _LINES_OF:
            raise ValueError(f"its compression is {header.compression}; save it with ZIP or none")
        if any(dtype.kind != "f" for _, dtype in header.channels):
            raise ValueError("it has channels of whole numbers; save it in half or full floats")
    except _DAMAGE as error:
        raise LiveHandError(f"{path} must be an OpenEXR image that can be read here ({error})") from error
    return header


def _read_header(data: bytes) -> _Header:
    attributes, place = {}, 8
    while data[place]:
        name, place = _text(data, place)
        _, place = _text(data, place)
        (size,) = struct.unpack_from("<i", data, place)
        attributes[name] = data[place + 4 : place + 4 + size]
        place += 4 + size
    data_box, display_box = (struct.unpack("<4i", attributes[name]) for name in ("dataWindow", "displayWindow"))
    for box in (data_box, display_box):
        if min(_box_size(box)) < 1 or np.prod(_box_size(box)) > _MOST_PIXELS:
            raise ValueError(f"a window of {_box_size(box)} px")
    compression = _COMPRESSIONS[attributes["compression"][0]]
    return _Header(_read_channels(attributes["channels"]), compression, data_box, display_box, place + 1)


def _read_channels(data: bytes) -> tuple[tuple[str, np.dtype], ...]:
    channels, place = [], 0
    while data[place]:
        name, place = _text(data, place)
        kind, _, x_step, y_step = struct.unpack_from("<iIii", data, place)
        if (x_step, y_step) != (1, 1):
            raise ValueError(f"its channel {name} is subsampled")
        channels.append((name, _TYPES[kind]))
        place += 16
    return tuple(channels)


def _text(data: bytes, place: int) -> tuple[str, int]:
    end = data.index(b"\0", place)
    return data[place:end].decode(), end + 1


def _box_size(box: tuple[int, int, int, int]) -> tuple[int, int]:
    return box[2] - box[0] + 1, box[3] - box[1] + 1


def _channels_of(data: bytes, header: _Header) -> dict[str, np.ndarray]:
    width, height = _box_size(header.data_box)
    lines = _LINES_OF[header.compression]
    rows = np.zeros((height, width * sum(dtype.itemsize for _, dtype in header.channels)), np.uint8)
    is_read = np.zeros(height, bool)
    for offset in struct.unpack_from(f"<{-(-height // lines)}Q", data, header.size):
        y, size = struct.unpack_from("<ii", data, offset)
        top = y - header.data_box[1]
        block, packed = rows[top : top + lines], data[offset + 8 : offset + 8 + size]
        is_packed = header.compression != "none" and size < block.size
        unpacked = _unpacked(packed, block.size) if is_packed else np.frombuffer(packed, np.uint8)
        block[:] = unpacked.reshape(block.shape)
        is_read[top : top + lines] = True
    if not is_read.all():
        raise ValueError(f"{(~is_read).sum()} of {height} lines are missing")
    return _on_display(rows, header)


def _on_display(rows: np.ndarray, header: _Header) -> dict[str, np.ndarray]:
    """Place the channels of the data window's rows on the display window."""
    (width, height), (x0, y0) = header.size_px, header.display_box[:2]
    left, top, right, bottom = np.array(header.data_box) - [x0, y0, x0, y0]
    inside = slice(max(top, 0), min(bottom + 1, height)), slice(max(left, 0), min(right + 1, width))
    part = tuple(slice(side.start - first, side.stop - first) for side, first in zip(inside, (top, left), strict=True))
    channels, start = {}, 0
    for name, dtype in header.channels:
        stop = start + dtype.itemsize * (right - left + 1)
        channel = np.zeros((height, width), dtype.newbyteorder("="))
        if inside[0].start < inside[0].stop and inside[1].start < inside[1].stop:
            channel[inside] = np.ascontiguousarray(rows[:, start:stop]).view(dtype)[part]
        channels[name], start = channel, stop
    return channels


def _unpacked(packed: bytes, size: int) -> np.ndarray:
    """Unpack a ZIP block of a size: differences are added up, then the two halves are interleaved."""
    raw = np.frombuffer(zlib.decompressobj().decompress(packed, size + 1), np.uint8)
    steps = raw ^ 128  # minus 128, modulo 256 as their sum
    steps[0] ^= 128
    halves = np.cumsum(steps, dtype=np.uint8)
    block, middle = np.empty_like(halves), len(halves) // 2
    block[0::2], block[1::2] = halves[:middle], halves[middle:]
    return block


def _packed(block: np.ndarray) -> bytes:
    """Pack `block` as `_unpacked` reads it, or leave it as it is where that would not be smaller."""
    halves = np.concatenate([block[0::2], block[1::2]])
    differences = np.diff(halves, prepend=np.uint8(0)) + np.uint8(128)
    differences[0] = halves[0]
    packed = zlib.compress(differences.tobytes(), _ZIP_LEVEL)
    return packed if len(packed) < block.size else block.tobytes()


def _file_of(channels: dict[str, np.ndarray], text: Mapping[str, str]) -> bytes:
    names = sorted(channels)
    height, width = channels[names[0]].shape
    kinds = [_TYPES.index(channels[name].dtype.newbyteorder("<")) for name in names]
    header = _header_bytes(names, kinds, (width, height), text)
    columns = [np.ascontiguousarray(channels[name], _TYPES[kind]) for name, kind in zip(names, kinds, strict=True)]
    rows = np.concatenate([column.view(np.uint8) for column in columns], 1)
    lines = _LINES_OF["ZIP"]
    blocks = [_packed(rows[top : top + lines].ravel()) for top in range(0, height, lines)]
    starts = np.cumsum([len(header) + 8 * len(blocks)] + [8 + len(block) for block in blocks])[:-1]
    chunks = [struct.pack("<ii", index * lines, len(block)) + block for index, block in enumerate(blocks)]
    return b"".join([header, struct.pack(f"<{len(blocks)}Q", *starts), *chunks])


def _header_bytes(names: list[str], kinds: list[int], size_px: tuple[int, int], text: Mapping[str, str]) -> bytes:
    width, height = size_px
    box = struct.pack("<4i", 0, 0, width - 1, height - 1)
    channels = b"".join(
        name.encode() + b"\0" + struct.pack("<iIii", kind, 0, 1, 1) for name, kind in zip(names, kinds, strict=True)
    )
    attributes = {
        "channels": ("chlist", channels + b"\0"),
        "compression": ("compression", bytes([_COMPRESSIONS.index("ZIP")])),
        "dataWindow": ("box2i", box),
        "displayWindow": ("box2i", box),
        "lineOrder": ("lineOrder", b"\0"),
        "pixelAspectRatio": ("float", struct.pack("<f", 1)),
        "screenWindowCenter": ("v2f", struct.pack("<2f", 0, 0)),
        "screenWindowWidth": ("float", struct.pack("<f", 1)),
        **{name: ("string", value.encode()) for name, value in text.items()},
    }
    parts = [struct.pack("<II", _MAGIC, _VERSION)]
    for name, (kind, value) in attributes.items():
        parts += [name.encode() + b"\0", kind.encode() + b"\0", struct.pack("<i", len(value)), value]
    return b"".join([*parts, b"\0"])
