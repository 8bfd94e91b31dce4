"""Signed manifests (C2PA, Content Credentials) in PNG, JPEG and MP4 files, by the user's own certificate.

The package `c2pa-python` is the extra `c2pa`. No server is asked, neither for a time stamp nor for a certificate's
state, so a reader knows the signer by the certificate, and whether to trust it is the reader's choice.
"""

from __future__ import annotations

import argparse
import io
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..records.errors import LiveHandError
from ..system.files import MIB, check_regular, read_regular, replacing
from .provenance import livehand_version

SIGNED_SUFFIXES = (".png", ".jpg", ".jpeg", ".mp4")
INSTALL = 'pip install "livehand[c2pa]"'
_ORIGIN = "org.livehand.origin"
_RENDERED = "http://cv.iptc.org/newscodes/digitalsourcetype/trainedAlgorithmicMedia"
_CREATED = {"label": "c2pa.actions", "data": {"actions": [{"action": "c2pa.created", "digitalSourceType": _RENDERED}]}}
_QUIET = {"builder": {"thumbnail": {"enabled": False}}, "verify": {"ocsp_fetch": False, "remote_manifest_fetch": False}}
_UNTRUSTED = "signingCredential.untrusted"  # the certificate is not on a list of trust, of which we ship none


@dataclass(frozen=True)
class SigningKey:
    """A certificate chain and its private key, both PEM, and the algorithm of the key as C2PA calls it."""

    certificate: bytes
    private_key: bytes
    algorithm: str


@dataclass(frozen=True)
class Manifest:
    """What a file's manifest says.

    Attributes:
        is_valid: whether the file is as it was signed.
        faults: codes of what is wrong.
        signer: the certificate's name.
        issuer: who vouches for it.
        origin: what the signer says of the picture's avatars; empty: nothing.
    """

    is_valid: bool
    faults: tuple[str, ...]
    signer: str
    issuer: str
    origin: Mapping[str, Any]


def add_signing_arguments(parser: argparse.ArgumentParser, is_required: bool) -> None:
    """Declare a command's certificate and private key."""
    parser.add_argument(
        "--certificate",
        type=Path,
        required=is_required,
        metavar="CHAIN.pem",
        help="signed manifests (C2PA): your certificate, and those that vouch for it",
    )
    parser.add_argument(
        "--private-key", type=Path, required=is_required, metavar="KEY.pem", help="its private key, without a password"
    )


def signing_key(args: argparse.Namespace) -> SigningKey | None:
    """Read the files that `add_signing_arguments` declares; None: neither is given.

    Raises:
        LiveHandError: one alone is given, or as `read_signing_key`.
    """
    if (args.certificate is None) != (args.private_key is None):
        raise LiveHandError("a signature needs both --certificate and --private-key, got one; give the other, too")
    return None if args.certificate is None else read_signing_key(args.certificate, args.private_key)


def read_signing_key(certificate: Path, private_key: Path) -> SigningKey:
    """Read certificate chain and private key, and sign a test with them.

    Raises:
        LiveHandError: a file is missing or no PEM, the key is locked or of a kind that C2PA does not know, or the
            certificate cannot sign.
    """
    c2pa = _imported()
    chain, key = read_regular(certificate, MIB), read_regular(private_key, MIB)
    signing = SigningKey(chain, key, _algorithm(key, private_key))
    try:
        _try(signing)
    except c2pa.C2paError as error:
        raise LiveHandError(
            f"{certificate} must be a PEM chain for C2PA, its signer's certificate first and not self-signed, with the "
            f"key {private_key}; got {error}"
        ) from error
    return signing


def _try(signing: SigningKey) -> None:
    """Sign a picture of one pixel, and verify it; raises C2paError."""
    from PIL import Image

    c2pa, picture, signed = _imported(), io.BytesIO(), io.BytesIO()
    Image.new("L", (1, 1)).save(picture, "PNG")
    with c2pa.Signer.from_info(_info(signing)) as signer, c2pa.Builder({"assertions": [_CREATED]}) as builder:
        builder.sign(signer, "image/png", picture, signed)
    with c2pa.Reader("image/png", signed) as reader:
        manifest = _manifest(json.loads(reader.json()), reader.get_validation_results() or {})
    if not manifest.is_valid:
        raise c2pa.C2paError.Signature(", ".join(manifest.faults))


def sign_file(path: Path, signing: SigningKey, origin: Mapping[str, Any]) -> None:
    """Put a signed manifest into a file, which is replaced whole.

    Args:
        path: a PNG, JPEG or MP4; an older manifest in it becomes the ingredient that C2PA makes of it.
        signing: of the user.
        origin: of JSON's types, the assertion about the avatars shown.

    Raises:
        LiveHandError: the file is of another kind or damaged, or cannot be written.
    """
    c2pa = _imported()
    check_signable(path)
    manifest = {
        "claim_generator_info": [{"name": "LiveHand", "version": livehand_version()}],
        "assertions": [
            _CREATED,
            {"label": _ORIGIN, "data": dict(origin)},
        ],
    }
    try:
        settings = c2pa.Settings.from_dict(_QUIET)
        with (
            replacing(path) as signed,
            c2pa.Context(settings) as context,
            c2pa.Signer.from_info(_info(signing)) as signer,
            c2pa.Builder(manifest, context) as builder,
        ):
            signed.unlink(missing_ok=True)
            builder.sign_file(path, signed, signer)
    except c2pa.C2paError as error:
        raise LiveHandError(f"{path} could not be signed ({error}); check that the file is whole") from error


def read_manifest(path: Path) -> Manifest | None:
    """Read and verify the manifest in a file; None: it has none.

    Raises:
        LiveHandError: the file cannot be read.
    """
    c2pa = _imported()
    check_signable(path)
    try:
        with c2pa.Context(c2pa.Settings.from_dict(_QUIET)) as context, c2pa.Reader(path, context=context) as reader:
            return _manifest(json.loads(reader.json()), reader.get_validation_results() or {})
    except c2pa.C2paError.ManifestNotFound:
        return None
    except (c2pa.C2paError, ValueError) as error:
        raise LiveHandError(f"{path} must be a whole PNG, JPEG or MP4, got {error}") from error


def check_signable(path: Path) -> None:
    """Raise LiveHandError unless there is a file of a kind that can be signed."""
    check_regular(path)
    if path.suffix.lower() not in SIGNED_SUFFIXES:
        raise LiveHandError(
            f"a signed file must be one of {', '.join(SIGNED_SUFFIXES)}, got {path.name}; C2PA has no place in others"
        )


def can_sign() -> bool:
    """Tell whether the package is installed."""
    from importlib.util import find_spec

    return find_spec("c2pa") is not None


def _manifest(store: dict[str, Any], results: Mapping[str, Any]) -> Manifest:
    active = store["manifests"][store["active_manifest"]]
    failures = (one["code"] for one in (results.get("activeManifest") or {}).get("failure", ()))
    faults = tuple(sorted({code for code in failures if code != _UNTRUSTED}))
    signature = active.get("signature_info") or {}
    origin = next((one["data"] for one in active.get("assertions", ()) if one["label"] == _ORIGIN), {})
    return Manifest(not faults, faults, signature.get("common_name", ""), signature.get("issuer", ""), origin)


def _info(signing: SigningKey) -> Any:
    return _imported().C2paSignerInfo(signing.algorithm.encode(), signing.certificate, signing.private_key, None)


def _algorithm(key: bytes, path: Path) -> str:
    """Return C2PA's name of the algorithm that a private key is for."""
    from cryptography.hazmat.primitives.asymmetric import ec, ed25519, rsa
    from cryptography.hazmat.primitives.serialization import load_pem_private_key

    try:
        loaded = load_pem_private_key(key, None)
    except (ValueError, TypeError) as error:
        raise LiveHandError(
            f"{path} must be a PEM private key without a password, got {error}; write one with openssl pkey"
        ) from error
    curves = {"secp256r1": "es256", "secp384r1": "es384", "secp521r1": "es512"}
    if isinstance(loaded, ec.EllipticCurvePrivateKey) and loaded.curve.name in curves:
        return curves[loaded.curve.name]
    if isinstance(loaded, ed25519.Ed25519PrivateKey):
        return "ed25519"
    if isinstance(loaded, rsa.RSAPrivateKey):
        return "ps256"
    raise LiveHandError(f"{path} must be a key of P-256, P-384, P-521, Ed25519 or RSA, got another kind")


def _imported() -> Any:
    try:
        import c2pa
    except ImportError as error:
        raise LiveHandError(f"signed pictures need the package c2pa-python; {INSTALL}") from error
    return c2pa
