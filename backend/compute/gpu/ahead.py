"""Kernels compiled ahead for NVIDIA's chips, without a GPU: where Warp looks for them, no first frame waits.

Warp keeps them in its own cache, each module in a folder named after its text, its options and Warp's version, and
compiles what it does not find: what was compiled for another version is never run.
"""

from __future__ import annotations

import contextlib
import shutil
import tempfile
import time
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

import warp as wp

from ...records.errors import LiveHandError
from . import kernels

SHIPPED = Path(__file__).with_name("compiled")
"""What a release brings, if it does: a folder for each module, named after its text."""
COMMON_CHIPS = 75, 86, 89, 90, 120
"""Compute capabilities, times ten: RTX 20 and T4; RTX 30; RTX 40; H100 and H200; RTX 50."""


class CompiledKernels(NamedTuple):
    """What was compiled.

    Attributes:
        folder: of Warp's cache, or as asked.
        files: one of each module and chip.
        seconds: that it took.
    """

    folder: Path
    files: tuple[Path, ...]
    seconds: float

    @property
    def size_bytes(self) -> int:
        """Of all files."""
        return sum(file.stat().st_size for file in self.files)


def kernel_modules() -> list[str]:
    """List the names of the modules that have kernels."""
    names = sorted(path.stem for path in Path(kernels.__file__ or "").parent.glob("*.py") if path.stem != "__init__")
    found = [f"{kernels.__name__}.{name}" for name in names]
    for name in found:
        import_module(name)
    return [name for name in found if wp.get_module(name).kernels]


def compile_kernels(chips: tuple[int, ...], folder: Path | None = None) -> CompiledKernels:
    """Compile all kernels for chips; takes most of a minute a chip.

    Args:
        chips: as `COMMON_CHIPS`.
        folder: to be shipped as `SHIPPED`; None: Warp's cache, where it looks for them.

    Raises:
        LiveHandError: Warp knows no such chip.
    """
    known, start = wp.get_cuda_supported_archs(), time.perf_counter()
    for chip in chips:
        if chip not in known:
            some = ", ".join(str(one / 10) for one in known)
            raise LiveHandError(f"a compute capability must be one that Warp knows ({some}), got {chip / 10}")
    files = [file for name in kernel_modules() for file in compile_module(name, chips, folder)]
    cache = Path(wp.config.kernel_cache_dir or "") if folder is None else folder
    return CompiledKernels(cache, tuple(files), time.perf_counter() - start)


def compile_module(name: str, chips: tuple[int, ...], folder: Path | None = None) -> list[Path]:
    """Compile one module, as `compile_kernels`."""
    module = wp.get_module(name)
    place = None if folder is None else folder / _shipped_name(module)
    files = [Path(file) for file in wp.compile_aot_module(module, arch=chips, module_dir=place, use_ptx=False)]
    if folder is not None:
        for source in files[0].parent.glob("*.cu"):
            source.unlink()
    return files


def use_shipped(folder: Path = SHIPPED) -> int:
    """Copy what is shipped into Warp's cache, where that lacks it; returns how many modules were copied.

    Modules are named after this package there, and it has another name in Blender; their text is the same.
    """
    wp.init()
    cache, copied = Path(wp.config.kernel_cache_dir or ""), 0
    for name in kernel_modules() if folder.is_dir() else []:
        module = wp.get_module(name)
        place, target = folder / _shipped_name(module), cache / module.get_module_identifier()
        if not place.is_dir() or target.exists():
            continue
        with tempfile.TemporaryDirectory(dir=cache) as temporary:
            filled = Path(temporary) / "module"
            filled.mkdir()
            for file in place.iterdir():
                ending = file.name.partition(_text_of(module))[2]
                shutil.copyfile(file, filled / f"{module.get_module_identifier()}{ending}")
            with contextlib.suppress(OSError):  # another process was first
                filled.rename(target)
                copied += 1
    return copied


def _text_of(module: wp.Module) -> str:
    """Return what Warp calls a module's text and options by."""
    return module.get_module_identifier().rpartition("_")[2]


def _shipped_name(module: wp.Module) -> str:
    return f"{module.name.rpartition('.')[2]}_{_text_of(module)}"
