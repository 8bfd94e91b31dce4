"""Complete and damaged frame files, written by Pillow and by a small EXR writer."""

import struct
import zlib

import numpy as np
import pytest
from livehand.backend.batch.frame_file import BrokenFrameError, check_frame, is_finished, read_exr_header
from PIL import Image

SIZE_PX = (6, 20)  # two chunks of 16 rows


def attribute(name, kind, data):
    return name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<i", len(data)) + data


def exr_bytes(size_px):
    """A zip-compressed scan-line file with one float channel of noise."""
    width, height = size_px
    channels = b"A\0" + struct.pack("<iiii", 2, 0, 1, 1) + b"\0"
    header = struct.pack("<ii", 20000630, 2)
    header += attribute("channels", "chlist", channels) + attribute("compression", "compression", b"\3")
    header += attribute("dataWindow", "box2i", struct.pack("<4i", 0, 0, width - 1, height - 1)) + b"\0"
    rows = np.random.default_rng(0).integers(0, 4, (height, width)).astype("<f4")
    packed = [zlib.compress(rows[first : first + 16].tobytes()) for first in range(0, height, 16)]
    chunks = [struct.pack("<ii", 16 * k, len(data)) + data for k, data in enumerate(packed)]
    starts = len(header) + 8 * len(chunks) + np.cumsum([0, *map(len, chunks)])[:-1]
    return header + struct.pack(f"<{len(chunks)}Q", *starts) + b"".join(chunks)


@pytest.fixture(params=["exr", "png"])
def frame(request, tmp_path):
    path = tmp_path / f"wave_0001.{request.param}"
    if request.param == "exr":
        path.write_bytes(exr_bytes(SIZE_PX))
    else:
        noise = np.random.default_rng(0).integers(0, 256, (*SIZE_PX[::-1], 4), np.uint8)
        Image.fromarray(noise).save(path)
    return path


def test_a_complete_frame_is_finished(frame):
    assert is_finished(frame, SIZE_PX)


def test_a_missing_frame_is_not_finished(tmp_path):
    assert not is_finished(tmp_path / "wave_0001.exr", SIZE_PX)


def test_a_frame_of_another_size_is_an_error(frame):
    with pytest.raises(BrokenFrameError, match="must be 6 x 21, it is 6 x 20"):
        check_frame(frame, (6, 21))


@pytest.mark.slow
def test_every_truncation_is_detected(frame):
    whole = frame.read_bytes()
    for length in range(len(whole)):
        frame.write_bytes(whole[:length])
        assert not is_finished(frame, SIZE_PX), length


def test_another_kind_of_file_is_an_error(frame):
    frame.write_text("no image, but long enough for a header")
    with pytest.raises(BrokenFrameError):
        check_frame(frame, SIZE_PX)


def test_the_header_has_size_channels_and_compression():
    (part,), position = read_exr_header(exr_bytes(SIZE_PX))
    assert (part.size_px, part.channels, part.compression) == (SIZE_PX, {"A": 4}, 3)
    assert [part.unpacked_size(chunk) for chunk in range(part.chunk_count)] == [16 * 6 * 4, 4 * 6 * 4]
    assert position < len(exr_bytes(SIZE_PX))


def test_a_picture_whose_chunk_claims_to_be_shorter_is_not_finished(tmp_path):
    """Its end is there, and Pillow raises a ValueError for its header."""
    path = tmp_path / "wave_0001.png"
    Image.new("RGBA", SIZE_PX).save(path)
    raw = bytearray(path.read_bytes())
    cut_header = struct.pack(">I", 12) + b"IHDR" + raw[16:28]
    path.write_bytes(raw[:8] + cut_header + struct.pack(">I", zlib.crc32(cut_header[4:])) + raw[33:])
    assert not is_finished(path, SIZE_PX)
