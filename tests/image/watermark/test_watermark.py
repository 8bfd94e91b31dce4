"""A watermark is invisible, and all of its bits outlive what happens to pictures; pictures without one have none."""

import io

import numpy as np
import pytest
from livehand.backend.image.watermark.detection import WatermarkReader, read_watermark
from livehand.backend.image.watermark.embedding import watermarked
from livehand.backend.image.watermark.signal import BITS, BYTES, TILE, patterns
from PIL import Image

pytestmark = pytest.mark.slow

WIDTH, HEIGHT = 334, 512
PAYLOADS = [bytes(range(17, 17 + BYTES)), b"\0" * BYTES, b"\xff" * BYTES]
NOTICED_MSE = 0.38  # of 255 squared: 0.1 dB where a picture differs from its truth by 36 dB


def hand_picture(seed=0):
    """Linear premultiplied colours and coverage of a palm with fingers: shaded, with pores and creases."""
    rng = np.random.default_rng(seed)
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    height = np.zeros((HEIGHT, WIDTH))
    for x, y, width, length in [(167, 340, 105, 130), (75, 170, 24, 130), (130, 130, 26, 130), (190, 130, 26, 130)]:
        away = ((columns - x) / width) ** 2 + ((rows - y) / length) ** 2
        height = np.maximum(height, np.sqrt(np.clip(1 - away, 0, 1)))
    fine = np.asarray(
        Image.fromarray(rng.normal(size=(128, 84)).astype(np.float32)).resize((WIDTH, HEIGHT), Image.Resampling.BICUBIC)
    )
    shade = (0.12 + 0.35 * height + 0.08 * columns / WIDTH) * (1 + 0.05 * fine + 0.02 * np.sin(rows / 9.0))
    shade *= 1 + 0.04 * rng.normal(size=shade.shape)
    coverage = np.clip(height * 6, 0, 1).astype(np.float32)
    rgb = np.clip(shade, 0.01, None)[..., None] * np.array([1.0, 0.7, 0.55]) * coverage[..., None]
    return rgb.astype(np.float32), coverage


def shown(rgb):
    """As a display shows it on black: uint8."""
    clipped = np.clip(rgb, 0, 1)
    encoded = np.where(clipped <= 0.0031308, clipped * 12.92, 1.055 * clipped ** (1 / 2.4) - 0.055)
    return (encoded * 255).round().astype(np.uint8)


def jpeg(picture):
    file = io.BytesIO()
    Image.fromarray(picture).save(file, "JPEG", quality=50)
    return np.asarray(Image.open(file))


def resized(picture, share):
    size = round(picture.shape[1] * share), round(picture.shape[0] * share)
    return np.asarray(Image.fromarray(picture).resize(size, Image.Resampling.LANCZOS))


ATTACKS = {
    "none": lambda picture: picture,
    "a JPEG of quality 50": jpeg,
    "half the size": lambda picture: resized(picture, 0.5),
    "twice the size": lambda picture: resized(picture, 2),
    "half the width": lambda picture: picture[:, 83 : 83 + WIDTH // 2],
    "half the height": lambda picture: picture[151 : 151 + HEIGHT // 2],
    "moved by a pixel": lambda picture: picture[1:, 1:],
}


def test_patterns_are_orthogonal_and_always_the_same():
    waves = patterns().astype(np.float64)
    np.testing.assert_allclose(waves @ waves.T / TILE**2, np.eye(BITS), atol=1e-5)
    np.testing.assert_allclose(waves[0, :4], [0.59553874, 0.39946964, 2.4269378, 1.7953681], atol=2e-4)


@pytest.mark.parametrize("name", ATTACKS)
def test_all_bits_outlive(name):
    for seed, payload in enumerate(PAYLOADS[: 3 if name == "a JPEG of quality 50" else 1]):
        rgb, coverage = hand_picture(seed)
        reading = read_watermark(ATTACKS[name](shown(watermarked(rgb, coverage, payload))))
        assert reading.agreement(payload) == BITS
        assert reading.is_sure


def test_a_film_in_h264_keeps_all_bits(tmp_path):
    av = pytest.importorskip("av")
    path = tmp_path / "film.mp4"
    with av.open(str(path), "w") as film:
        stream = film.add_stream("libx264", rate=24, options={"crf": "23"})
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv420p"
        for frame in range(12):
            rgb, coverage = (np.roll(one, 3 * frame, 1) for one in hand_picture())
            picture = shown(watermarked(rgb, coverage, PAYLOADS[0]))
            film.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        film.mux(stream.encode())
    with av.open(str(path)) as film:
        reader = WatermarkReader((1.0,))
        for frame in film.decode(video=0):
            reader.add(frame.to_ndarray(format="rgb24"), frame.key_frame)
    reading = reader.reading()
    assert reading.agreement(PAYLOADS[0]) == BITS
    assert reading.is_sure


def test_nobody_notices_it():
    rgb, coverage = hand_picture()
    before, after = shown(rgb).astype(float), shown(watermarked(rgb, coverage, PAYLOADS[0])).astype(float)
    assert 0.01 < ((after - before) ** 2).mean() < NOTICED_MSE
    assert np.abs(after - before).max() <= 14
    np.testing.assert_array_equal(after[coverage == 0], 0)


def test_only_hands_change_in_a_scene():
    rgb, coverage = hand_picture()
    room = np.random.default_rng(5).uniform(0.1, 0.4, (HEIGHT // 8, WIDTH // 8 + 1, 1)).repeat(8, 0).repeat(8, 1)
    scene = rgb + room[:, :WIDTH] * (1 - coverage)[..., None]
    marked = watermarked(scene, coverage, PAYLOADS[0])
    np.testing.assert_array_equal(marked[coverage < 0.2], scene[coverage < 0.2])
    assert read_watermark(shown(marked)).agreement(PAYLOADS[0]) == BITS


def test_a_picture_without_one_has_none():
    for seed in range(2):
        reading = read_watermark(shown(hand_picture(seed)[0]))
        assert not reading.is_sure
        assert all(reading.agreement(payload) < 52 for payload in PAYLOADS)
    assert not read_watermark(np.zeros((64, 64, 3), np.uint8)).is_sure


@pytest.mark.parametrize("size", [(0, 0), (1, 5), (64, 64), (65, 33)])
def test_a_picture_without_a_hand_stays(size):
    rgb = np.full((*size, 3), 0.2, np.float32)
    np.testing.assert_array_equal(watermarked(rgb, np.zeros(size, np.float32), PAYLOADS[0]), rgb)


def test_brightness_beyond_white_stays():
    rgb, coverage = hand_picture()
    rgb[300:340, 150:190] = 7.5
    marked = watermarked(rgb, coverage, PAYLOADS[0])
    np.testing.assert_allclose(marked[304:336, 154:186], rgb[304:336, 154:186], rtol=1e-6)  # some roundings
    assert np.isfinite(marked).all()


def test_a_payload_has_eight_bytes():
    with pytest.raises(ValueError, match="8 bytes, got 4"):
        watermarked(*hand_picture(), b"four")
