"""Kernels compiled for NVIDIA's common chips, without a GPU: their registers, and what spills.

A kernel that keeps more than registers hold goes to slow local memory, and nothing but its time would tell. All modules
are compiled by night; by day one of them, and what reads the files.
"""

import contextlib
import struct

import pytest
import warp as wp
import warp._src.build as build
from livehand.backend.compute.gpu import ahead
from livehand.backend.compute.gpu.ahead import (
    COMMON_CHIPS,
    compile_kernels,
    compile_module,
    kernel_modules,
    use_shipped,
)
from livehand.backend.compute.gpu.kernels.tiles import THREADS
from livehand.backend.records.errors import LiveHandError

pytestmark = pytest.mark.slow

MODULES = kernel_modules()
BY_DAY = next(name for name in MODULES if name.endswith(".surfels"))
MOST_REGISTERS = 168  # 384 threads at a time on a multiprocessor of 65,536
# Of tiles on chips without room for them in fewer: 256 threads at a time, in blocks of 128.
MOST_OF_TILES = {75: 232, 120: 255}
MOST_STACK_BYTES = 64
# Local arrays, which cannot be registers as their places are not known ahead: a pixel's values of the maps.
STACK_BYTES = {"add_skin": 256}


def resources(cubin):
    """Kernel -> (registers, bytes of stack), from the ELF sections of a cubin."""
    (sections_at,), (count, names_at) = struct.unpack_from("<Q", cubin, 0x28), struct.unpack_from("<HH", cubin, 0x3C)
    sections = [struct.unpack_from("<IIQQQQIIQQ", cubin, sections_at + 64 * index) for index in range(count)]

    def text(start, offset):
        return cubin[start + offset : cubin.index(b"\0", start + offset)].decode()

    named = {text(sections[names_at][4], one[0]): one for one in sections}
    symbols = named[".symtab"]
    symbol_names = [
        text(sections[symbols[6]][4], struct.unpack_from("<I", cubin, symbols[4] + 24 * index)[0])
        for index in range(symbols[5] // 24)
    ]
    found = {}
    at, end = named[".nv.info"][4], named[".nv.info"][4] + named[".nv.info"][5]
    while at < end:
        form, attribute, size = struct.unpack_from("<BBH", cubin, at)
        if form == 4:  # with a value of `size` bytes: here a symbol and a number
            if attribute in (REGISTERS, FRAME_BYTES):
                symbol, number = struct.unpack_from("<II", cubin, at + 4)
                found.setdefault(symbol_names[symbol], {})[attribute] = number
            at += size
        at += 4
    return {name: (one[REGISTERS], one.get(FRAME_BYTES, 0)) for name, one in found.items() if REGISTERS in one}


REGISTERS, FRAME_BYTES = 0x2F, 0x11


def check_module(name, chip, folder):
    (file,) = compile_module(name, (chip,), folder)
    used = {one.partition("_cuda_kernel")[0]: of_one for one, of_one in resources(file.read_bytes()).items()}
    assert len(used) == sum(len(one.overloads) if one.is_generic else 1 for one in wp.get_module(name).kernels.values())
    for kernel, (registers, stack) in used.items():
        most = next((limit for start, limit in STACK_BYTES.items() if kernel.startswith(start)), MOST_STACK_BYTES)
        is_of_tiles = kernel.startswith("multiply_rows_") and not kernel.startswith("multiply_rows_plainly")
        held = MOST_OF_TILES.get(chip, MOST_REGISTERS) if is_of_tiles else MOST_REGISTERS
        assert 8 <= registers <= held, kernel
        assert stack <= most, kernel
    return used


@pytest.mark.nightly
@pytest.mark.parametrize("chip", COMMON_CHIPS)
@pytest.mark.parametrize("name", MODULES)
def test_registers_hold_what_a_kernel_keeps(name, chip, tmp_path):
    check_module(name, chip, tmp_path)


def test_registers_hold_what_a_kernel_of_one_module_keeps(tmp_path, monkeypatch):
    registers, _ = check_module(BY_DAY, 90, tmp_path).popitem()[1]
    monkeypatch.setitem(globals(), "MOST_REGISTERS", registers - 1)
    with pytest.raises(AssertionError):
        check_module(BY_DAY, 90, tmp_path)


def test_kernels_are_compiled_where_warp_looks_for_them(tmp_path, monkeypatch):
    """In its own cache, a folder for each module's text; found again, nothing is compiled."""
    monkeypatch.setattr(wp.config, "kernel_cache_dir", str(tmp_path))
    monkeypatch.setattr(ahead, "kernel_modules", lambda: [BY_DAY])
    done = compile_kernels((86,))
    module = wp.get_module(BY_DAY)
    (file,) = done.files
    assert file == tmp_path / module.get_module_identifier() / module._get_compile_output_name(None, 86)
    assert 4_000 < done.size_bytes < 200_000
    assert done.folder == tmp_path


def test_what_launches_tiles_has_the_threads_they_are_compiled_for():
    module = wp.get_module(next(name for name in MODULES if name.endswith(".tiles")))
    assert module.get_module_identifier() == module.get_module_identifier(THREADS)
    assert module.get_module_identifier() != module.get_module_identifier(256)


def test_a_chip_that_is_not_known_is_named():
    with pytest.raises(LiveHandError, match=r"got 6\.1"):
        compile_kernels((86, 61))


def test_what_is_shipped_is_copied_to_where_warp_looks_for_it_whatever_the_package_is_called(tmp_path, monkeypatch):
    shipped, cache = tmp_path / "compiled", tmp_path / "cache"
    cache.mkdir()
    monkeypatch.setattr(ahead, "kernel_modules", lambda: [BY_DAY])
    (file,) = compile_kernels((89,), shipped).files
    names = {one.name for one in file.parent.iterdir()}
    assert {one.partition(".sm")[2] for one in names} == {"89.cubin", ""}
    monkeypatch.setattr(wp.config, "kernel_cache_dir", str(cache))
    module = wp.get_module(BY_DAY)
    monkeypatch.setattr(module, "name", "bl_ext.somewhere.livehand.surfels")
    assert use_shipped(shipped) == 1
    found = cache / module.get_module_identifier() / module._get_compile_output_name(None, 89)
    assert found.read_bytes() == file.read_bytes()
    assert (found.parent / module._get_meta_name()).is_file()
    assert [one.name for one in cache.iterdir()] == [found.parent.name]
    assert use_shipped(shipped) == 0
    assert not is_compiled(module, 89, monkeypatch)
    assert is_compiled(module, 86, monkeypatch)
    (cache / found.parent.name / found.name).unlink()
    assert use_shipped(tmp_path / "nothing") == 0


class Chip:
    """What Warp asks of a GPU before it compiles for it."""

    is_cpu, is_cuda, alias = False, True, "cuda:0"

    def __init__(self, arch):
        self.arch = arch

    def get_cuda_compile_arch(self):
        return self.arch

    def get_cuda_output_format(self, preferred=None):
        return "cubin"

    def _get_cuda_arch_suffix(self, arch):
        return ""


def is_compiled(module, arch, monkeypatch):
    """Whether Warp would compile a module for a GPU, as it loads it."""
    asked, device = [], Chip(arch)
    monkeypatch.setattr(build, "build_cuda", lambda *_, **__: asked.append(1))
    folder = f"{wp.config.kernel_cache_dir}/{module.get_module_identifier()}"
    with contextlib.suppress(OSError):  # of what was asked for, nothing is there
        module._compile(device, folder, module._get_compile_output_name(device), arch)
    return bool(asked)


def test_what_was_shipped_for_another_text_is_left(tmp_path, monkeypatch):
    (tmp_path / "compiled" / "surfels_0000000").mkdir(parents=True)
    monkeypatch.setattr(ahead, "kernel_modules", lambda: [BY_DAY])
    monkeypatch.setattr(wp.config, "kernel_cache_dir", str(tmp_path))
    assert use_shipped(tmp_path / "compiled") == 0
