"""The tracker's networks, fetched as a user fetches them, and small films of pictures of our own hand."""

import json
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from livehand.backend.records.errors import LiveHandError
from livehand.backend.system.package_files import fetch_files
from livehand.backend.tracking.tracker import HandTracker
from livehand.backend.tracking.weights import PACKAGE, has_networks, keep_networks, load_networks, tracker_folder
from PIL import Image

HERE = Path(__file__).parent
KEPT = HERE.parents[1] / "out" / "tracker"


@pytest.fixture(scope="session")
def networks():
    if has_networks():
        return load_networks()
    if not has_networks(KEPT):
        try:
            keep_networks(fetch_files(PACKAGE), KEPT)
        except LiveHandError as error:
            pytest.skip(f"the tracker's networks cannot be fetched: {error}")
    return load_networks(KEPT)


@pytest.fixture(scope="session")
def networks_folder(networks):
    return tracker_folder() if has_networks() else KEPT


@pytest.fixture
def tracker(networks):
    return HandTracker(networks)


@pytest.fixture(scope="session")
def shown():
    """A function (name) -> uint8 [720, 1280, 3], our own hand before a grey ground."""
    return lambda name: np.asarray(Image.open(HERE / "pictures" / f"{name}.jpg").convert("RGB"))


@pytest.fixture(scope="session")
def two_hands(shown):
    """uint8 [360, 640, 3], a right hand beside a left one."""
    return np.ascontiguousarray(np.concatenate([shown("palm")[::2, 360:1000:2], shown("left")[::2, 100:740:2]], 1))


@pytest.fixture(scope="session")
def reference():
    """What MediaPipe 0.10.21 found in the pictures: at first sight and after the eighth; numbers only."""
    return json.loads((HERE / "mediapipe.json").read_text())


@pytest.fixture
def film(tmp_path):
    """A function (pictures, name, times, codec, ...) -> path of a video."""
    av = pytest.importorskip("av", reason="PyAV (the extra video) is not installed")

    def write(pictures, name="film.mp4", times=None, codec="libx264", pixels="yuv420p", **codec_options):
        path = tmp_path / name
        with av.open(str(path), "w") as container:
            stream = container.add_stream(codec, rate=30)
            stream.height, stream.width = pictures[0].shape[:2]
            stream.pix_fmt = pixels
            stream.codec_context.time_base = Fraction(1, 3000)
            for option, value in codec_options.items():
                setattr(stream.codec_context, option, value)
            for index, picture in enumerate(pictures):
                frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(picture), format="rgb24")
                frame.time_base = Fraction(1, 3000)
                frame.pts = round(3000 * (index / 30 if times is None else times[index]))
                container.mux(stream.encode(frame))
            container.mux(stream.encode(None))
        return path

    return write
