"""A small OpenEXR reader for tests, after https://openexr.com/en/latest/OpenEXRFileLayout.html."""

import struct
import zlib

import numpy as np
from livehand.backend.batch.frame_file import read_exr_header

ROWS_PER_CHUNK = 16


def read_exr(path):
    """{channel: [H, W]} of a zip-compressed scan-line file; Blender 5 writes a part for each pass."""
    data = path.read_bytes()
    parts, position = read_exr_header(data)
    channels = {}
    for part in parts:
        offsets = struct.unpack_from(f"<{part.chunk_count}Q", data, position)
        position += 8 * part.chunk_count
        # A chunk begins with its part's number, where there are several.
        channels |= read_part(data, part, [offset + 4 * (len(parts) > 1) for offset in offsets])
    return channels


def read_part(data, part, offsets):
    assert part.compression == 3
    width, height = part.size_px
    channels = {name: np.zeros((height, width), f"<f{size}") for name, size in part.channels.items()}
    for chunk, offset in enumerate(offsets):
        _, size = struct.unpack_from("<ii", data, offset)
        packed, expected = data[offset + 8 : offset + 8 + size], part.unpacked_size(chunk)
        raw = packed if size == expected else unpacked(zlib.decompress(packed))
        read = 0
        for row in range(chunk * ROWS_PER_CHUNK, min(height, (chunk + 1) * ROWS_PER_CHUNK)):
            for image in channels.values():
                image[row] = np.frombuffer(raw, image.dtype, width, read)
                read += width * image.dtype.itemsize
    return channels


def unpacked(data):
    """Undo the predictor (differences) and the split into even and odd bytes."""
    values = np.frombuffer(data, np.uint8).astype(np.int64)
    values[1:] -= 128
    values = np.cumsum(values).astype(np.uint8)
    half = (len(values) + 1) // 2
    out = np.empty_like(values)
    out[0::2], out[1::2] = values[:half], values[half:]
    return out.tobytes()
