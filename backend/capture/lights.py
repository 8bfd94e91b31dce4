"""The lights of a capture, as `transforms.json` version 2 lists them; their skies are OpenEXR files of their own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cache
from pathlib import Path
from typing import Any, get_args

import numpy as np

from ..records.errors import LiveHandError
from ..records.light import Lamp, LampKind, Light, Sky
from .exr import read_exr, write_exr

GREY = 0.5
"""Albedo of occluders whose own is not known."""
_KEYS = ("kind", "lamps", "sky_path", "sky_group", "occluders", "occluder_albedo")


@dataclass(frozen=True)
class CaptureLight:
    """A light of a capture.

    Attributes:
        kind: a free label by which results are listed, such as soft, key, rim or block.
        light: lamps, sky and occluders, in the capture's world.
    """

    kind: str
    light: Light


def sky_path(index: int) -> str:
    """Name the file of a light's sky, relative to the capture's folder."""
    return f"lights/sky{index:04d}.exr"


def light_entry(index: int, light: CaptureLight) -> dict:
    """Write out the light's entry in `transforms.json`."""
    entry: dict = {"kind": light.kind, "lamps": [_lamp_entry(lamp) for lamp in light.light.lamps]}
    sky = light.light.sky
    if sky is not None:
        entry |= {"sky_path": sky_path(index)} | ({"sky_group": sky.group} if sky.group else {})
    occluders, albedo = light.light.occluders, light.light.occluder_albedo
    if len(occluders):
        known = albedo if len(albedo) else np.zeros((len(occluders), 3))
        entry |= {"occluders": np.asarray(occluders).tolist(), "occluder_albedo": np.asarray(known).tolist()}
    return entry


def _lamp_entry(lamp: Lamp) -> dict:
    """Write out the lamp's attributes that differ from the defaults."""
    entry: dict = {"kind": lamp.kind, "rgb": np.asarray(lamp.rgb).tolist()}
    plain = _plain_lamp()
    for name in _lamp_fields()[2:]:
        value = getattr(lamp, name)
        if not np.array_equal(value, getattr(plain, name)):
            entry[name] = np.asarray(value).tolist()
    return entry


@cache
def _lamp_fields() -> tuple[str, ...]:
    return tuple(one.name for one in fields(Lamp))


@cache
def _plain_lamp() -> Lamp:
    return Lamp("point", np.zeros(3))


def write_skies(folder: Path, lights: Sequence[CaptureLight]) -> None:
    """Write every light's sky, in half floats where they hold it exactly, else in full ones.

    Raises:
        LiveHandError: a file cannot be written.
    """
    for index, light in enumerate(lights):
        if light.light.sky is not None:
            write_exr(folder / sky_path(index), _sky_channels(light.light.sky))


def _sky_channels(sky: Sky) -> dict[str, np.ndarray]:
    radiance = np.asarray(sky.radiance, np.float32)
    with np.errstate(over="ignore"):
        half = radiance.astype(np.float16)
    stored = half if np.array_equal(half, radiance) else radiance
    return {name: stored[..., channel] for channel, name in enumerate("RGB")}


def read_light(folder: Path, name: str, entry: object) -> CaptureLight:
    """Read the light of an entry of `lights`, which messages call by this name.

    Raises:
        LiveHandError: with the entry's name and its fault.
    """
    if not isinstance(entry, dict) or not isinstance(entry.get("lamps", []), list):
        raise LiveHandError(f"{name} must be an object with a list of lamps, got {str(entry)[:40]}...")
    unknown = sorted(set(entry) - set(_KEYS))
    if unknown:
        raise LiveHandError(f"{name} must have no other keys than {_KEYS}, got {unknown}")
    try:
        lamps = tuple(_read_lamp(lamp) for lamp in entry.get("lamps", []))
        occluders = np.array(entry.get("occluders", np.zeros((0, 3, 3))), float).reshape(-1, 3, 3)
        light = Light(lamps, _read_sky(folder, entry), occluders, _read_albedo(entry, len(occluders)))
        return CaptureLight(str(entry.get("kind", "")), light)
    except (LiveHandError, TypeError, ValueError, OverflowError) as error:
        raise LiveHandError(f"{name}: {error}") from error


def _read_lamp(entry: object) -> Lamp:
    if not isinstance(entry, dict) or "kind" not in entry or "rgb" not in entry:
        raise LiveHandError(f"a lamp must have a kind and rgb, got {str(entry)[:60]}")
    unknown = sorted(set(entry) - set(_lamp_fields()))
    if unknown:
        raise LiveHandError(f"a lamp must have no other keys than {_lamp_fields()}, got {unknown}")
    values: dict[str, Any] = {name: _lamp_value(name, value) for name, value in entry.items()}
    return Lamp(**values)


def _lamp_value(name: str, value: object) -> object:
    default = getattr(_plain_lamp(), name)
    if name == "kind" and value not in get_args(LampKind):
        raise LiveHandError(f"a lamp's kind must be one of {get_args(LampKind)}, got {value!r}")
    if isinstance(default, np.ndarray):
        return np.array(value, float)
    if isinstance(default, tuple):
        return tuple(float(number) for number in value)  # type: ignore[attr-defined]
    if not isinstance(value, str if isinstance(default, str) else bool if isinstance(default, bool) else float | int):
        raise LiveHandError(f"a lamp's {name} must be like {default!r}, got {value!r}")
    return float(value) if isinstance(default, float) else value


def _read_sky(folder: Path, entry: dict) -> Sky | None:
    path = entry.get("sky_path")
    if path is None:
        return None
    if not isinstance(path, str):
        raise LiveHandError(f"sky_path must be a file's name, got {path!r}")
    channels = read_exr(folder / path)
    if not {"R", "G", "B"} <= set(channels):
        raise LiveHandError(f"{folder / path} must have channels R, G and B, got {sorted(channels)}")
    return Sky(np.stack([channels[name].astype(np.float32) for name in "RGB"], -1), str(entry.get("sky_group", "")))


def _read_albedo(entry: dict, count: int) -> np.ndarray:
    return np.array(entry.get("occluder_albedo", np.full((count, 3), GREY)), float).reshape(-1, 3)
