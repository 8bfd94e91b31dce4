"""The file of an avatar (`.safetensors`, never a pickle).

Its metadata has one entry, `livehand`, in JSON: format version, hand model, configuration, provenance, metrics, the
description of its surface, and a checksum over everything else, by which an altered file is refused. Versions 1, of
avatars in the light of their capture, and 2, of relightable ones, are read, too. docs/dev/avatar_format.md documents
the format for users.
"""

from __future__ import annotations

import hashlib
import json
import logging
from dataclasses import asdict
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor, nn

from ..field.field import FieldConfig
from ..field.sampler import SamplerConfig
from ..image.superres import SuperResConfig, build_superres
from ..records.errors import LiveHandError
from ..records.light import Sky
from ..surface.people.look import PersonLook
from ..surface.stored_surface import StoredSurface
from ..system.files import MIB, check_regular, is_file, replacing
from ..system.readers import parse_json
from . import drawn_people
from .avatar import Avatar, AvatarConfig, build_field
from .captured_surface import surface_of_provenance
from .identities import checked_names
from .library import check_avatar_path, shipped_avatar_path
from .metadata import HEADER_KEY, THUMBNAIL_KEY
from .tensors import read_surface_tensors, stored_weights, surface_tensors, whole_weights

LOGGER = logging.getLogger(__name__)
VERSION = 3
"""Of the files that are written; those of versions 1 and 2 are read, too."""
_SURFACE_KEY = "surface"
_SKY_KEY = "sky"
_HEADER_KEYS = {"name", "hand_name", "hand_sha256", "config", "provenance", "metrics"}
_MOST_BYTES = 1024 * MIB
_DTYPES = {f"torch.{name}" for name in ("float16", "float32", "uint8", "int8", "int16", "int64")}
_LARGEST_SHELL_M, _MOST_SAMPLES = 0.1, 1024


def save_avatar(avatar: Avatar, path: Path) -> None:
    """Write the avatar, its weights in half precision and a relightable one's planes in a byte a value (`weights`).

    Raises:
        LiveHandError: the file cannot be written.
    """
    weights = {
        prefix + key: value.detach().cpu()
        for prefix, network in _networks(avatar).items()
        for key, value in network.state_dict().items()
    }
    tensors = stored_weights(weights, has_byte_planes=avatar.config.field.light == "linear")
    if avatar.thumbnail is not None:
        tensors[THUMBNAIL_KEY] = torch.from_numpy(avatar.thumbnail)
    header: dict[str, Any] = {
        "format_version": VERSION,
        "name": avatar.name,
        "hand_name": avatar.hand_name,
        "hand_sha256": avatar.hand_sha256,
        "config": asdict(avatar.config),
        "provenance": avatar.provenance,
        "metrics": avatar.metrics,
    }
    if avatar.sky is not None:
        tensors[_SKY_KEY] = torch.as_tensor(avatar.sky.radiance, dtype=torch.float16)
    if avatar.surface is not None:
        header[_SURFACE_KEY], arrays = surface_tensors(avatar.surface)
        tensors |= arrays
    _write(header, tensors, path)


def _write(header: dict[str, Any], tensors: dict[str, Tensor], path: Path) -> None:
    header["checksum"] = _checksum(header, tensors)
    with replacing(path) as temporary:
        temporary.write_bytes(save(tensors, metadata={HEADER_KEY: json.dumps(header, sort_keys=True)}))


def load_avatar(path: Path | str | None = None) -> Avatar:
    """Read an avatar; None reads the first of the shipped avatars.

    Raises:
        LiveHandError: the file is missing, not an avatar, truncated, altered, of a newer version, or has
            weights that are not finite, or a surface that is broken or of another hand.
    """
    path = Path(path) if path is not None else shipped_avatar_path()
    header, tensors = _read(path)
    if drawn_people.LOOK_KEY in header:
        return _kept_person(path, header, tensors)
    missing = sorted(_HEADER_KEYS - header.keys())
    if missing:
        raise LiveHandError(f"{path} must have {', '.join(missing)} in its header, got none; train it again")
    config = _config_of(header["config"], path)
    surface = _surface_of(header, tensors, path)
    tensors = whole_weights(tensors, path)
    _check_networks(config, tensors, path)
    avatar = Avatar(
        name=header["name"],
        hand_name=header["hand_name"],
        hand_sha256=header["hand_sha256"],
        config=config,
        field=build_field(config.field),
        superres=build_superres(config.superres),
        provenance=header["provenance"],
        metrics=header["metrics"],
        thumbnail=tensors.pop(THUMBNAIL_KEY).numpy() if THUMBNAIL_KEY in tensors else None,
        sky=_sky(tensors.pop(_SKY_KEY), path) if _SKY_KEY in tensors else None,
        surface=surface,
    )
    try:
        for prefix, network in _networks(avatar).items():
            weights = {k.removeprefix(prefix): v.float() for k, v in tensors.items() if k.startswith(prefix)}
            network.load_state_dict(weights)
            faulty = [prefix + key for key, value in network.state_dict().items() if not value.isfinite().all()]
            if faulty:
                raise LiveHandError(f"{path}: the weights must be finite, got others in {faulty[0]}; train it again")
    except RuntimeError as error:
        raise LiveHandError(f"{path}: the weights must fit the configuration, got {error}") from error
    return avatar


def write_record(avatar: Avatar, look: PersonLook, path: Path) -> None:
    """Write a drawn person as numbers and thumbnail alone.

    Raises:
        LiveHandError: the file cannot be written.
    """
    header = {"format_version": VERSION, **drawn_people.record_header(avatar, look)}
    tensors = {} if avatar.thumbnail is None else {THUMBNAIL_KEY: torch.as_tensor(avatar.thumbnail)}
    _write(header, tensors, path)


def check_keeps_networks(path: Path) -> None:
    """Refuse to write into a record, which would become a whole avatar of the version that wrote it.

    Raises:
        LiveHandError: the file is one, or as `load_avatar`.
    """
    header = read_header(path)
    if drawn_people.LOOK_KEY in header:
        numbers = drawn_people.look_of(header, path).facts().items()
        options = " ".join(f"--{name} {value:g}" if name != "seed" else f"--seed {value}" for name, value in numbers)
        raise LiveHandError(
            f"{path} must be an avatar with networks to be written into, got the record of a person's numbers; make "
            f"an avatar of them with: livehand new-person {options} -o FILE.safetensors"
        )


def _kept_person(path: Path, header: dict[str, Any], tensors: dict[str, Tensor]) -> Avatar:
    """Load the avatar of a record, which is made when it is loaded for the first time."""
    kept = drawn_people.made_path(path, header)
    if is_file(kept):
        return load_avatar(kept)
    thumbnail = tensors[THUMBNAIL_KEY].numpy() if THUMBNAIL_KEY in tensors else None
    LOGGER.warning("drawing the skin of %s, once: some 20 seconds", header["name"])
    avatar = drawn_people.made_avatar(path, header, thumbnail, load_avatar)
    try:
        kept.parent.mkdir(parents=True, exist_ok=True)
        save_avatar(avatar, kept)
    except (OSError, LiveHandError) as error:
        LOGGER.warning("%s is drawn anew each time: %s", header["name"], error)
    return avatar


def read_header(path: Path) -> dict[str, Any]:
    """Read the header of an avatar's file, after checking the file as `load_avatar` does."""
    return _read(path)[0]


def read_surface_of(path: Path) -> StoredSurface | None:
    """Read the surface of an avatar's file, without its networks; None: it has none.

    Raises:
        LiveHandError: as `load_avatar`.
    """
    header, tensors = _read(path)
    return _surface_of(header, tensors, path)


def _read(path: Path) -> tuple[dict[str, Any], dict[str, Tensor]]:
    check_avatar_path(path)
    check_regular(path, _MOST_BYTES)
    try:
        with safe_open(path, framework="pt") as archive:
            metadata = archive.metadata() or {}
            tensors = {key: archive.get_tensor(key) for key in archive.keys()}
    except (SafetensorError, OSError) as error:
        raise LiveHandError(
            f"{path} must be a .safetensors avatar, got a file that is another one or cut short: {error}"
        ) from error
    if HEADER_KEY not in metadata:
        raise LiveHandError(f"{path} must be a LiveHand avatar, got a .safetensors file of something else")
    foreign = sorted({str(tensor.dtype) for tensor in tensors.values()} - _DTYPES)
    if foreign:
        raise LiveHandError(f"{path} must hold tensors of {', '.join(sorted(_DTYPES))}, got {', '.join(foreign)}")
    header = _parsed(metadata[HEADER_KEY])
    if header and header.get("format_version") not in range(1, VERSION + 1):
        raise LiveHandError(
            f"{path} must be of avatar format 1 to {VERSION}, got {header.get('format_version')}; update LiveHand"
        )
    if header.pop("checksum", None) != _checksum(header, tensors):
        raise LiveHandError(
            f"{path} must match its own checksum, got an altered or damaged avatar; download or train it again"
        )
    return header, tensors


def _parsed(text: str) -> dict[str, Any]:
    """Parse the header; empty if its text is damaged."""
    try:
        header = parse_json(text.encode(), "the header")
    except (LiveHandError, ValueError):
        return {}
    return header if isinstance(header, dict) else {}


def _checksum(header: dict[str, Any], tensors: dict[str, Tensor]) -> str:
    digest = hashlib.sha256(json.dumps(header, sort_keys=True).encode())
    for key in sorted(tensors):
        digest.update(key.encode())
        digest.update(tensors[key].numpy().tobytes())
    return digest.hexdigest()


def _networks(avatar: Avatar) -> dict[str, nn.Module]:
    """Return the networks by the prefix of their tensors."""
    return {"field.": avatar.field, "superres.": avatar.superres}


def _config_of(values: dict[str, Any], path: Path) -> AvatarConfig:
    try:
        planes = tuple(tuple(plane) for plane in values["field"]["planes"])
        identities = checked_names(tuple(map(str, values["field"].get("identities", ()))))
        superres: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in values["superres"].items()}
        config = AvatarConfig(
            FieldConfig(**{**values["field"], "planes": planes, "identities": identities}),
            SuperResConfig(**superres),
            SamplerConfig(**values["sampler"]),
        )
        if not 0 < config.sampler.shell_m < _LARGEST_SHELL_M:
            raise TypeError(f"a shell of {config.sampler.shell_m} m")
        for value in (config.sampler.samples_per_ray, config.sampler.max_layers):
            if value not in range(1, _MOST_SAMPLES + 1):
                raise TypeError(f"{value!r} samples or layers of a ray")
    except (KeyError, TypeError, AttributeError, LiveHandError) as error:
        raise LiveHandError(f"{path}: the avatar's configuration must be this version's, got {error}") from error
    return config


def _check_networks(config: AvatarConfig, tensors: dict[str, Tensor], path: Path) -> None:
    """Compare the networks of a configuration with the tensors, before memory is taken for them."""
    try:
        if max(config.superres.depth, len(config.field.planes)) > len(tensors):
            raise ValueError(f"{max(config.superres.depth, len(config.field.planes))} layers")
        with torch.device("meta"):
            networks = {"field.": build_field(config.field), "superres.": build_superres(config.superres)}
    except Exception as error:  # a configuration may hold anything
        raise LiveHandError(
            f"{path}: the avatar's configuration must be this version's, got {type(error).__name__}: {error}"
        ) from error
    wanted = {
        prefix + key: list(value.shape) for prefix, one in networks.items() for key, value in one.state_dict().items()
    }
    got = {key: list(value.shape) for key, value in tensors.items() if key.startswith(tuple(networks))}
    different = sorted(key for key in wanted.keys() | got.keys() if wanted.get(key) != got.get(key))
    if different:
        key = different[0]
        raise LiveHandError(
            f"{path}: the weights must fit the configuration, got {len(different)} that do not, such as {key}: "
            f"{got.get(key)} for {wanted.get(key)}"
        )


def _surface_of(header: dict[str, Any], tensors: dict[str, Tensor], path: Path) -> StoredSurface | None:
    """Build the avatar's surface; its tensors are taken out."""
    hand_sha256 = header.get("hand_sha256")
    if not isinstance(hand_sha256, str):
        raise LiveHandError(f"{path}: hand_sha256 must be text, got {str(hand_sha256)[:40]}; train it again")
    if header["format_version"] < VERSION:
        provenance = header.get("provenance")
        return surface_of_provenance(provenance.get("capture") if isinstance(provenance, dict) else None, hand_sha256)
    surface = read_surface_tensors(header.get(_SURFACE_KEY), tensors, str(path))
    if surface is not None and surface.hand_sha256 != hand_sha256:
        raise LiveHandError(
            f"{path}: the surface must lie on the avatar's hand {hand_sha256[:12]}..., got one of hand "
            f"{surface.hand_sha256[:12]}..."
        )
    return surface


def _sky(radiance: Tensor, path: Path) -> Sky:
    if radiance.ndim != 3 or radiance.shape[2] != 3 or not radiance.isfinite().all():
        raise LiveHandError(f"{path}: the sky must be finite and [H, W, 3], got {list(radiance.shape)}")
    return Sky(radiance.float().numpy())
