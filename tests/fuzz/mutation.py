"""Changes files at random: bytes of any, values of JSON documents and of arrays."""

import io
import json

import numpy as np

_WORDS = [
    b"",
    b"\0",
    b"\xff\xff\xff\xff",
    b"\xff\xff\xff\x7f",
    b"\x00\x00\x00\x80",
    b"-1",
    b"1e400",
    b"NaN",
    b"[" * 200,
]
_VALUES = [
    *(None, True, 0, -1, 1, 2**31, 2**63, 10**400, 1e308, 1e-320, float("nan"), float("inf"), "", "x", "\0", "é" * 300),
    *("../../../../etc/passwd", "/dev/zero", "Left", [], {}, [[]], [None], {"x": 1}, [1, 2, 3], "9" * 5000),
]
_DTYPES = ("f8", "f4", "f2", "i8", "u1", "?", "c16", "U3", "S2", "M8[s]", ">f8")


def mutated_bytes(raw, rng):
    """A few bytes flipped, cut, doubled, moved or replaced by special ones."""
    data = bytearray(raw)
    for _ in range(1 + int(rng.integers(4))):
        start = int(rng.integers(len(data) + 1))
        length = int(rng.integers(1, 1 + min(64, max(1, len(data)))))
        kind = rng.integers(6)
        if kind == 0 and data:
            data[start % len(data)] ^= 1 << int(rng.integers(8))
        elif kind == 1:
            del data[start:]
        elif kind == 2:
            del data[start : start + length]
        elif kind == 3:
            data[start:start] = data[start : start + length] * int(rng.integers(1, 20))
        elif kind == 4:
            data[start:start] = _WORDS[rng.integers(len(_WORDS))]
        else:
            word = _WORDS[rng.integers(len(_WORDS))]
            data[start : start + len(word)] = word
    return bytes(data)


def mutated_json(raw, rng):
    """A JSON text with one to three of its values replaced, removed or doubled."""
    document = json.loads(raw)
    for _ in range(1 + int(rng.integers(3))):
        document = _changed(document, rng)
    if rng.random() < 0.02:
        document = _nested(document, int(rng.integers(2, 3000)))
        return document
    return json.dumps(document).encode()


def _nested(document, depth):
    return b"[" * depth + json.dumps(document).encode() + b"]" * depth


def _changed(value, rng):
    if isinstance(value, dict | list) and value and rng.random() < 0.85:
        key = list(value)[rng.integers(len(value))] if isinstance(value, dict) else int(rng.integers(len(value)))
        copy = value.copy()
        kind = rng.random()
        if kind < 0.1:
            del copy[key]
        elif kind < 0.15 and isinstance(copy, list):
            copy += copy[key : key + 1] * int(rng.integers(1, 50))
        elif kind < 0.2 and isinstance(copy, dict):
            copy[str(_VALUES[rng.integers(len(_VALUES))])[:50]] = copy.pop(key)
        else:
            copy[key] = _changed(value[key], rng)
        return copy
    return _VALUES[rng.integers(len(_VALUES))]


def mutated_npz(raw, rng):
    """Arrays with other values, types, shapes or names."""
    with np.load(io.BytesIO(raw)) as archive:
        arrays = dict(archive)
    for _ in range(1 + int(rng.integers(2))):
        key = list(arrays)[rng.integers(len(arrays))]
        arrays[key] = changed_array(arrays[key], rng)
        if rng.random() < 0.1:
            arrays.pop(key)
        if not arrays:
            break
    file = io.BytesIO()
    np.savez(file, **arrays)
    return file.getvalue()


def changed_array(array, rng):
    """One array with other values, another type or another shape."""
    kind = rng.integers(6)
    if kind == 0:
        dtype = np.dtype(_DTYPES[rng.integers(len(_DTYPES))])
        if array.dtype.kind in "SU" and dtype.kind == "M":  # numpy 1.26 crashes
            return array
        with np.errstate(all="ignore"):
            try:
                return array.astype(dtype)
            except (ValueError, TypeError):
                return array
    if kind == 1 and array.dtype.kind == "f" and array.size:
        copy = array.copy()
        with np.errstate(over="ignore"):
            copy.flat[rng.integers(array.size)] = (np.nan, np.inf, 1e300, -1e300, 1e-300)[rng.integers(5)]
        return copy
    if kind == 2 and array.ndim:
        return array[: rng.integers(len(array) + 1)] if len(array) else array
    if kind == 3:
        return array[None] if rng.random() < 0.5 else array.ravel()
    if kind == 4 and array.ndim > 1:
        return array.swapaxes(0, 1)
    if kind == 5 and array.dtype.kind in "iu" and array.size:
        copy = array.astype("i8")
        copy.flat[rng.integers(array.size)] = (-1, 2**31, 2**62, 10**6)[rng.integers(4)]
        return copy
    return np.zeros((int(rng.integers(4)),) * int(rng.integers(4)))
