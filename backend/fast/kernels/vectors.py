"""A block of a convolution in vector registers: numba has no vector types, so the block is written as LLVM's own.

It multiplies bf16 in pairs and adds in fp32 (AVX-512 BF16), at the processor's peak. Where the instruction is missing,
or LLVM does not know it by this signature, `has_bf16_products` is false and torch does the work.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import llvmlite.binding
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

LANES = 16
"""Channels in a vector of sums."""
_OLDEST_LLVM = 17
_SIDE = 3

_ADDRESS, _WORD = ir.IntType(64), ir.IntType(32)
_SUMS, _WORDS = ir.VectorType(ir.FloatType(), LANES), ir.VectorType(_WORD, LANES)


class _BFloat(ir.Type):
    """LLVM's bfloat, which llvmlite lacks."""

    def _to_string(self) -> str:
        return "bfloat"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _BFloat)

    def __hash__(self) -> int:
        return hash(_BFloat)


_BF16S = ir.VectorType(_BFloat(), 2 * LANES)


@cache
def has_bf16_products() -> bool:
    """Whether this processor and this LLVM have the instruction."""
    is_known = llvmlite.binding.llvm_version_info[0] >= _OLDEST_LLVM
    return is_known and bool(llvmlite.binding.get_host_cpu_features().get("avx512bf16"))


def _window_sums(typingctx, pixels, vectors, source, pixel_bytes, row_bytes, pairs, weights, sums):
    """Store the sums of 3 x 3 windows over bf16 channels: fp32 [pixels, 16 * vectors].

    Args:
        typingctx: numba's.
        pixels: neighbours in a row, a literal.
        vectors: of output channels, a literal.
        source: address of the upper left pixel of the first window.
        pixel_bytes: from a pixel to the next.
        row_bytes: from a row to the next.
        pairs: of input channels.
        weights: address of bf16 [9, pairs, 16 * vectors, 2]; fastest if aligned to 64 bytes.
        sums: address of the result.
    """
    if not (isinstance(pixels, types.IntegerLiteral) and isinstance(vectors, types.IntegerLiteral)):
        return None
    pixel_count, vector_count = pixels.literal_value, vectors.literal_value
    signature = types.void(pixels, vectors, *[types.intp] * 6)

    def codegen(context, builder, signature, arguments):
        _WindowCode(builder, pixel_count, vector_count).build(*arguments[2:])
        return context.get_dummy_value()

    return signature, codegen


window_sums: Callable[..., None] = intrinsic(prefer_literal=True)(_window_sums)
"""Called by kernels, without `typingctx`."""


class _WindowCode:
    """Builds the code of `window_sums`: sums stay in registers over the whole window."""

    def __init__(self, builder: ir.IRBuilder, pixels: int, vectors: int):
        self.builder, self.pixels, self.vectors = builder, pixels, vectors
        self.product = builder.module.declare_intrinsic(
            "llvm.x86.avx512bf16.dpbf16ps.512", (), ir.FunctionType(_SUMS, [_SUMS, _BF16S, _BF16S])
        )
        self.sums = [[cgutils.alloca_once(builder, _SUMS) for _ in range(vectors)] for _ in range(pixels)]

    def build(self, source, pixel_bytes, row_bytes, pairs, weights, sums) -> None:
        """Loop over the window and the pairs of channels, then store the sums."""
        builder = self.builder
        for row in self.sums:
            for one in row:
                builder.store(ir.Constant(_SUMS, [0.0] * LANES), one)
        tap_bytes = builder.mul(pairs, self._address(self._pair_bytes))
        side = self._address(_SIDE)
        with cgutils.for_range(builder, side) as dy, cgutils.for_range(builder, side) as dx:
            corner = builder.add(builder.mul(dy.index, row_bytes), builder.mul(dx.index, pixel_bytes))
            tap = builder.add(builder.mul(dy.index, side), dx.index)
            first = builder.add(source, corner)
            pixels = [
                builder.add(first, builder.mul(self._address(pixel), pixel_bytes)) for pixel in range(self.pixels)
            ]
            weight = builder.add(weights, builder.mul(tap, tap_bytes))
            with cgutils.for_range(builder, pairs) as pair:
                self._add_pair(pixels, weight, pair.index)
        self._store(sums)

    @property
    def _pair_bytes(self) -> int:
        return 4 * LANES * self.vectors

    def _add_pair(self, pixels, weight, pair) -> None:
        builder = self.builder
        at = builder.add(weight, builder.mul(pair, self._address(self._pair_bytes)))
        factors = [self._load(at, 4 * LANES * vector, _WORDS) for vector in range(self.vectors)]
        offset = builder.mul(pair, self._address(4))
        for pixel, sums in zip(pixels, self.sums, strict=True):
            value = self._spread(self._load(builder.add(pixel, offset), 0, _WORD))
            for factor, total in zip(factors, sums, strict=True):
                products = [builder.load(total), builder.bitcast(value, _BF16S), builder.bitcast(factor, _BF16S)]
                builder.store(builder.call(self.product, products), total)

    def _store(self, sums) -> None:
        flat = [one for row in self.sums for one in row]
        for index, one in enumerate(flat):
            pointer = self._pointer(sums, 4 * LANES * index, _SUMS)
            self.builder.store(self.builder.load(one), pointer, align=4)

    def _spread(self, word):
        """The word in every lane."""
        nothing = ir.Constant(_WORDS, ir.Undefined)
        first = self.builder.insert_element(nothing, word, ir.Constant(_WORD, 0))
        return self.builder.shuffle_vector(first, nothing, ir.Constant(_WORDS, [0] * LANES))

    def _load(self, address, offset: int, of_type: ir.Type):
        return self.builder.load(self._pointer(address, offset, of_type), align=4)

    def _pointer(self, address, offset: int, to_type: ir.Type):
        return self.builder.inttoptr(self.builder.add(address, self._address(offset)), to_type.as_pointer())

    @staticmethod
    def _address(value: int) -> ir.Constant:
        return ir.Constant(_ADDRESS, value)
