"""The origin of a picture: which avatar it shows, under which licence, and what its person agreed to."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from ..records.errors import LiveHandError
from .metadata import THUMBNAIL_KEY, read_metadata

_PAYLOAD_BYTES = 8


@dataclass(frozen=True)
class Origin:
    """What an avatar's pictures tell of it.

    Attributes:
        name: the avatar's.
        licence: of the avatar, or empty.
        consent: what its person agreed to, or empty.
        payload: 8 bytes for a watermark: a hash of the avatar's weights and surface, of its hand and its licence.
            Another thumbnail or other metrics in the same file do not change it. A marked avatar (`marking`) keeps the
            bits that it was marked with.
        is_marked: whether all frames of the avatar get the watermark, even if nobody asks for one.
    """

    name: str
    licence: str
    consent: str
    payload: bytes
    is_marked: bool = False


def read_origin(path: Path) -> Origin:
    """Read the origin that pictures of an avatar's file have.

    Raises:
        LiveHandError: the file is missing or not an avatar.
    """
    try:
        stat = path.stat()
    except OSError as error:
        raise LiveHandError(f"no avatar at {path} ({error.strerror}); give an avatar's .safetensors file") from error
    return _origin_of(path, stat.st_mtime_ns, stat.st_size)


def frame_payload(origins: Sequence[Origin], is_wanted: bool) -> bytes | None:
    """Return the payload of a picture of these avatars; None: none is wanted, and none of them asks for one."""
    marking = [one.payload for one in origins if is_wanted or one.is_marked]
    return joint_payload(marking) if marking else None


def joint_payload(payloads: Iterable[bytes]) -> bytes:
    """Return the payload of a picture that shows several avatars: of one, its own; of more, a hash of all."""
    different = sorted(set(payloads))
    return different[0] if len(different) == 1 else _hash(*different)


@lru_cache(maxsize=64)
def _origin_of(path: Path, mtime_ns: int, size: int) -> Origin:
    """Read the origin, once for a file of this time and size."""
    from safetensors import safe_open

    metadata = read_metadata(path)
    if metadata.watermark is not None:
        return Origin(metadata.name, metadata.licence, metadata.consent, metadata.watermark, is_marked=True)
    digest = hashlib.sha256()
    with safe_open(path, framework="numpy") as archive:
        names = sorted(set(archive.keys()) - {THUMBNAIL_KEY})
        for name in names:
            digest.update(name.encode())
            digest.update(archive.get_tensor(name).tobytes())
    if not names:
        digest.update(metadata.made_from.encode())  # a person's numbers are all that a record has
    payload = _hash(digest.digest(), metadata.hand_sha256.encode(), metadata.licence.encode())
    return Origin(metadata.name, metadata.licence, metadata.consent, payload)


def _hash(*parts: bytes) -> bytes:
    return hashlib.sha256(b"\0".join((b"livehand origin", *parts))).digest()[:_PAYLOAD_BYTES]
