"""The machine that a benchmark runs on: its description and its measured peaks.

The peaks are those of the fastest of several large matrix products, a convolution and copies in torch, on as many
threads as the benchmark uses.
"""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import torch
from torch.nn.functional import conv2d

from ...compute.precision import has_fast_bf16
from ...render.backends import has_int8_kernels, has_numba

_REPEATS = 7
_PRODUCTS_OF_INT8 = 4
_BUSY = 0.25
"""Load of other programs, as a share of the processors, from which on a machine counts as busy."""


class Loads(NamedTuple):
    """What is timed for the peaks.

    Attributes:
        products: (m, k, n) of matrix products: large and square, and tall and narrow like a small network over many
            samples; CPUs differ in which is faster.
        convolution: (channels, side in px) of a 3 x 3 convolution: on some processors torch's convolutions use wider
            registers than its products.
        copy_mb: size of the copy, MiB.
    """

    products: tuple[tuple[int, int, int], ...]
    convolution: tuple[int, int]
    copy_mb: int


LOADS = {
    "cpu": Loads(((2048, 2048, 2048), (4096, 256, 256)), (64, 160), 256),
    "cuda": Loads(((8192, 8192, 8192),), (256, 512), 2048),
}


class Peaks(NamedTuple):
    """What the machine reaches.

    Attributes:
        fp32_flops: FLOP/s of large products or convolutions in single precision.
        bf16_flops: the same in bfloat16; where that is slower, networks run in single precision, and so does this.
        bytes_per_s: of a copy, both ways.
        int8_flops: of the kernels' int8, derived: an instruction takes four products where single precision takes one;
            0 where there are no such instructions.
    """

    fp32_flops: float
    bf16_flops: float
    bytes_per_s: float
    int8_flops: float = 0.0

    @property
    def reduced_flops(self) -> float:
        """Of networks in reduced precision."""
        return max(self.bf16_flops, self.int8_flops)

    def or_better(self, other: Peaks) -> Peaks:
        """Take the higher of each, since other load on the machine can only lower a peak."""
        return Peaks(*(max(pair) for pair in zip(self, other, strict=True)))


def set_threads(count: int | None) -> None:
    """Set the threads of torch and, where it is installed, numba; None keeps their own choice."""
    if count is None:
        return
    torch.set_num_threads(count)
    if has_numba():
        import numba

        numba.set_num_threads(min(count, numba.config.NUMBA_NUM_THREADS))  # type: ignore[attr-defined]


def describe(device: torch.device) -> dict[str, str | float | bool | None]:
    """Describe hardware and software that the figures depend on; what is not known is None."""
    flags = _cpu_flags()
    return {
        "cpu": _cpu_name(),
        "cores": os.cpu_count(),
        "threads": torch.get_num_threads(),
        "gpu": torch.cuda.get_device_name(device) if device.type == "cuda" else None,
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "torch": torch.__version__,
        "numba": has_numba(),
        **_load(),
        "amx": None if flags is None else "amx_bf16" in flags,
        "avx512_bf16": None if flags is None else "avx512_bf16" in flags,
        "avx512_vnni": None if flags is None else "avx512_vnni" in flags,
    }


@torch.inference_mode()
def measure_peaks(
    device: torch.device, wall_s: Callable[[], float] = time.perf_counter, loads: Loads | None = None
) -> Peaks:
    """Time products, convolutions and copies, for about a second; `loads` of None are those of the device."""
    products, convolution, copy_mb = loads or LOADS[device.type]

    def fastest(work: Callable[[], object]) -> float:
        return min(_took_s(work, device, wall_s) for _ in range(_REPEATS))

    def product_flops(dtype: torch.dtype, m: int, k: int, n: int) -> float:
        a, b = torch.ones(m, k, dtype=dtype, device=device), torch.ones(k, n, dtype=dtype, device=device)
        return 2 * m * k * n / fastest(lambda: a @ b)

    def convolution_flops(dtype: torch.dtype, channels: int, side_px: int) -> float:
        maps = torch.ones(1, channels, side_px, side_px, dtype=dtype, device=device)
        maps = maps.contiguous(memory_format=torch.channels_last)
        weight = torch.ones(channels, channels, 3, 3, dtype=dtype, device=device)
        return 2 * 9 * (channels * side_px) ** 2 / fastest(lambda: conv2d(maps, weight, padding=1))

    def peak_flops(dtype: torch.dtype) -> float:
        return max(*(product_flops(dtype, *shape) for shape in products), convolution_flops(dtype, *convolution))

    source = torch.zeros(copy_mb * 2**18, device=device)
    target = torch.zeros_like(source)
    copied = 2 * source.numel() * source.element_size()
    bytes_per_s = copied / fastest(lambda: target.copy_(source))
    fp32_flops = peak_flops(torch.float32)
    bf16_flops = peak_flops(torch.bfloat16) if has_fast_bf16(device) else fp32_flops  # networks then run in fp32
    int8_flops = _PRODUCTS_OF_INT8 * fp32_flops if device.type == "cpu" and has_int8_kernels() else 0.0
    return Peaks(fp32_flops, bf16_flops, bytes_per_s, int8_flops)


def _took_s(work: Callable[[], object], device: torch.device, wall_s: Callable[[], float]) -> float:
    _synchronise(device)
    began = wall_s()
    work()
    _synchronise(device)
    return wall_s() - began


def _synchronise(device: torch.device) -> None:
    if device.type == "cuda":
        torch.cuda.synchronize()


def _load() -> dict[str, float | bool | None]:
    """Count programs that wanted a processor in the minute before, and say whether they were enough to spoil figures.

    Both are None where the system does not tell.
    """
    if not hasattr(os, "getloadavg"):
        return {"load_before": None, "busy": None}
    load = os.getloadavg()[0]
    return {"load_before": round(load, 2), "busy": load > _BUSY * (os.cpu_count() or 1)}


def _cpu_name() -> str:
    lines = _cpu_info()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or "unknown"


def _cpu_flags() -> set[str] | None:
    lines = [line for line in _cpu_info() if line.startswith("flags")]
    return set(lines[0].partition(":")[2].split()) if lines else None


def _cpu_info() -> list[str]:
    path = Path("/proc/cpuinfo")
    return path.read_text().splitlines() if path.is_file() else []
