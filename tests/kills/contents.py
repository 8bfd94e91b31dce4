"""What the files of a run hold, without dates and durations: equal for an unbroken run and for one that was killed."""

import json
import re

import numpy as np
import torch
from livehand.backend.batch.frame_file import check_frame, read_exr_header
from PIL import Image
from safetensors import safe_open

_CLOCK = ("core_minutes", "ms", "ms_p10", "ms_p90", "core_s", "seconds", "group", "machine")


def content(path):
    """Of one file, in a form that `is_same` compares; raises if the file is not whole."""
    return _READERS.get(path.suffix, _bytes)(path)


def is_same(one, other):
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(is_same(one[key], other[key]) for key in one)
    if isinstance(one, torch.Tensor):
        return one.shape == other.shape and torch.allclose(one.float(), other.float(), atol=2e-3, rtol=1e-3)
    return np.array_equal(one, other) if isinstance(one, np.ndarray) else one == other


def _exr(path):
    data = path.read_bytes()
    parts, start = read_exr_header(data)
    check_frame(path, parts[0].size_px)
    return data[start + 8 * sum(part.chunk_count for part in parts) :]  # behind the header, which holds the date


def _picture(path):
    with Image.open(path) as image:
        return np.asarray(image)


def _npz(path):
    with np.load(path) as arrays:
        return dict(arrays)


def _tensors(path):
    with safe_open(path, framework="pt") as archive:
        return {key: archive.get_tensor(key) for key in archive.keys()}


def _json(path):
    if path.name == "speed.json":
        return sorted(json.loads(path.read_text()))
    return _timeless(json.loads(path.read_text()))


def _timeless(value):
    if isinstance(value, dict):
        return {key: _timeless(each) for key, each in value.items() if key not in _CLOCK}
    return [_timeless(each) for each in value] if isinstance(value, list) else value


def _log(path):
    return [json.loads(line)["step"] for line in path.read_text().splitlines()]


def _page(path):
    """Its words: the figures include durations, and the best of them are bold."""
    return re.findall(r"[A-Za-z]{3,}", re.sub(r"<[^>]*>", "", path.read_text()))


def _bytes(path):
    return path.read_bytes()


_READERS = {
    ".exr": _exr,
    ".png": _picture,
    ".jpg": _picture,
    ".npz": _npz,
    ".safetensors": _tensors,
    ".checkpoint": _tensors,
    ".json": _json,
    ".jsonl": _log,
    ".md": _page,
    ".html": _page,
}
