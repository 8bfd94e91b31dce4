"""Every kernel compiled for the oldest and for a new NVIDIA chip, without a GPU: its registers, and what spills.

A kernel that keeps more than registers hold goes to slow local memory, and nothing but its time would tell.
"""

import struct
from pathlib import Path

import pytest
import warp as wp
from livehand.backend.compute.gpu import kernels

pytestmark = pytest.mark.nightly

MODULES = sorted(path.stem for path in Path(kernels.__file__).parent.glob("*.py") if path.stem[0] != "_")
WITHOUT_KERNELS = {"compiled", "lobes"}
CHIPS = (75, 90)
MOST_REGISTERS = 168  # 384 threads at a time on a multiprocessor of 65,536
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


@pytest.mark.parametrize("chip", CHIPS)
@pytest.mark.parametrize("name", [name for name in MODULES if name not in WITHOUT_KERNELS])
def test_registers_hold_what_a_kernel_keeps(name, chip, tmp_path):
    module = wp.get_module(f"{kernels.__name__}.{name}")
    __import__(module.name)
    (file,) = wp.compile_aot_module(module, arch=chip, module_dir=tmp_path, use_ptx=False)
    used = {one.partition("_cuda_kernel")[0]: of_one for one, of_one in resources(Path(file).read_bytes()).items()}
    assert used
    for kernel, (registers, stack) in used.items():
        most = next((limit for start, limit in STACK_BYTES.items() if kernel.startswith(start)), MOST_STACK_BYTES)
        assert 8 <= registers <= MOST_REGISTERS, kernel
        assert stack <= most, kernel
