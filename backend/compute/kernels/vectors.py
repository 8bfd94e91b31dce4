"""Sums of products in vector registers: numba has no vector types, so these blocks are written as LLVM's own.

Weights are 32-bit words: an fp32 each, or four int8 of one output, which are multiplied by four uint8 of the source
(AVX-512 VNNI). On processors without these instructions `has_vectors` and `has_int8_products` are false. Where
registers are half as wide and half as many (AVX2), a block's sums are computed in several passes, of the same values.
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

_ADDRESS, _WORD = ir.IntType(64), ir.IntType(32)
_FLOATS, _WORDS = ir.VectorType(ir.FloatType(), LANES), ir.VectorType(_WORD, LANES)


@cache
def has_vectors() -> bool:
    """Return whether this processor multiplies and adds vectors of 16 numbers, in one register or in two."""
    return _has_wide_registers() or (_has("avx2") and _has("fma"))


@cache
def _has_wide_registers() -> bool:
    """Return whether a vector of 16 numbers is one register, and 24 sums and their factors fit into all of them."""
    return _has("avx512f")


@cache
def has_int8_products() -> bool:
    """Return whether this processor multiplies int8 in fours."""
    return has_vectors() and _has("avx512vnni")


@cache
def has_half_precision() -> bool:
    """Return whether this processor converts numbers of half precision."""
    return _has("f16c")


def _has(feature: str) -> bool:
    is_known = llvmlite.binding.llvm_version_info[0] >= _OLDEST_LLVM
    return is_known and bool(llvmlite.binding.get_host_cpu_features().get(feature))


def _window_sums(typingctx, side, pixels, vectors, source, start, pixel_bytes, row_bytes, weights, sums):
    """Store the sums of windows of side x side pixels: [pixels, 16 * vectors], as fp32 or int32.

    Args:
        typingctx: numba's.
        side: of a window, a literal.
        pixels: neighbours in a row, a literal.
        vectors: of outputs, a literal.
        source: array of fp32, or of uint8 in fours.
        start: byte in the source at which the upper left pixel of the first window begins.
        pixel_bytes: from a pixel to the next.
        row_bytes: from a row to the next.
        weights: [side * side, words of a pixel, >= 16 * vectors] fp32 or int32; fastest if aligned to 64 bytes.
        sums: array of the result.
    """
    literals = side, pixels, vectors
    if not all(isinstance(one, types.IntegerLiteral) for one in literals):
        return None
    signature = types.void(*literals, source, *[types.intp] * 3, weights, sums)

    def codegen(context, builder, signature, arguments):
        side, pixels, vectors = (one.literal_value for one in literals)
        arrays = [context.make_array(signature.args[at])(context, builder, arguments[at]) for at in (3, 7, 8)]
        code = _WindowCode(builder, side, pixels, vectors, is_int8=weights.dtype == types.int32)
        code.build(*arrays, *arguments[4:7])
        return context.get_dummy_value()

    return signature, codegen


window_sums: Callable[..., None] = intrinsic(prefer_literal=True)(_window_sums)
"""Called by kernels, without `typingctx`."""


class _WindowCode:
    """Builds the code of `window_sums`: sums stay in registers over the whole window."""

    def __init__(self, builder: ir.IRBuilder, side: int, pixels: int, vectors: int, is_int8: bool):
        self.builder, self.side, self.pixels, self.vectors = builder, side, pixels, vectors
        self.kind = _WORDS if is_int8 else _FLOATS
        name = "llvm.x86.avx512.vpdpbusd.512" if is_int8 else "llvm.fma.v16f32"
        self.function = builder.module.declare_intrinsic(name, (), ir.FunctionType(self.kind, [self.kind] * 3))
        self.is_int8 = is_int8
        self.at_once = vectors if _has_wide_registers() else 1
        self.sums = [[cgutils.alloca_once(builder, self.kind) for _ in range(self.at_once)] for _ in range(pixels)]

    def build(self, source, weights, sums, start, pixel_bytes, row_bytes) -> None:
        """Add up as many vectors of outputs at once as there are registers for, one pass after the other."""
        for first in range(0, self.vectors, self.at_once):
            self._build_pass(first, source, weights, sums, start, pixel_bytes, row_bytes)

    def _build_pass(self, first_vector, source, weights, sums, start, pixel_bytes, row_bytes) -> None:
        """Loop over the window and the words of a pixel, then store the sums."""
        builder = self.builder
        for row in self.sums:
            for one in row:
                builder.store(ir.Constant(self.kind, None), one)
        first = builder.add(self._address_of(source.data), start)
        factors = builder.add(self._address_of(weights.data), self._address(4 * LANES * first_vector))
        _, words, _ = cgutils.unpack_tuple(builder, weights.shape)
        tap_bytes, word_bytes, _ = cgutils.unpack_tuple(builder, weights.strides)
        side = self._address(self.side)
        with cgutils.for_range(builder, side) as dy, cgutils.for_range(builder, side) as dx:
            corner = builder.add(builder.mul(dy.index, row_bytes), builder.mul(dx.index, pixel_bytes))
            tap = builder.add(builder.mul(dy.index, side), dx.index)
            at = builder.add(first, corner)
            pixels = [builder.add(at, builder.mul(self._address(pixel), pixel_bytes)) for pixel in range(self.pixels)]
            weight = builder.add(factors, builder.mul(tap, tap_bytes))
            with cgutils.for_range(builder, words) as word:
                self._add_word(pixels, builder.add(weight, builder.mul(word.index, word_bytes)), word.index)
        self._store(self._address_of(sums.data), first_vector)

    def _add_word(self, pixels, weight, word) -> None:
        builder = self.builder
        factors = [self._load(weight, 4 * LANES * vector, self.kind) for vector in range(self.at_once)]
        offset = builder.mul(word, self._address(4))
        for pixel, sums in zip(pixels, self.sums, strict=True):
            value = self._spread(self._load(builder.add(pixel, offset), 0, self.kind.element))
            for factor, total in zip(factors, sums, strict=True):
                before = builder.load(total)
                operands = [before, value, factor] if self.is_int8 else [value, factor, before]
                builder.store(builder.call(self.function, operands), total)

    def _store(self, sums, first_vector: int) -> None:
        for pixel, row in enumerate(self.sums):
            for index, one in enumerate(row):
                offset = 4 * LANES * (pixel * self.vectors + first_vector + index)
                self.builder.store(self.builder.load(one), self._pointer(sums, offset, self.kind), align=4)

    def _spread(self, word):
        """Repeat the word in every lane."""
        nothing = ir.Constant(self.kind, ir.Undefined)
        first = self.builder.insert_element(nothing, word, ir.Constant(_WORD, 0))
        return self.builder.shuffle_vector(first, nothing, ir.Constant(_WORDS, [0] * LANES))

    def _load(self, address, offset: int, of_type: ir.Type):
        return self.builder.load(self._pointer(address, offset, of_type), align=4)

    def _pointer(self, address, offset: int, to_type: ir.Type):
        return self.builder.inttoptr(self.builder.add(address, self._address(offset)), to_type.as_pointer())

    def _address_of(self, pointer):
        return self.builder.ptrtoint(pointer, _ADDRESS)

    @staticmethod
    def _address(value: int) -> ir.Constant:
        return ir.Constant(_ADDRESS, value)


def _blend_texels(typingctx, table, first, texel, row, above, weights, share, out, to):
    """Store four channels between four texels, and between two layers of each, in out[to : to + 4].

    Args:
        typingctx: numba's.
        table: fp32, or the bits of half precision as uint16.
        first: where the channels of the first texel begin in the flat table.
        texel: from a texel to the next in its row.
        row: to the one in the next row.
        above: to the same channels of the next layer.
        weights: fp32 of the four texels.
        share: of the next layer.
        out: fp32.
        to: where.
    """
    signature = types.void(table, *[types.intp] * 4, types.UniTuple(types.float32, 4), types.float32, out, types.intp)

    def codegen(context, builder, signature, arguments):
        tables, first, texel, row, above, weights, share, outs, to = arguments
        data, result = (
            context.make_array(kind)(context, builder, value).data
            for kind, value in ((signature.args[0], tables), (signature.args[7], outs))
        )
        corners = first, builder.add(first, texel), builder.add(first, row), builder.add(builder.add(first, texel), row)
        factors = [_spread_four(builder, weight) for weight in cgutils.unpack_tuple(builder, weights)]

        def layer(offset):
            total = ir.Constant(_FOUR, None)
            for corner, factor in zip(corners, factors, strict=True):
                address = builder.gep(data, [builder.add(corner, offset)])
                values = _load_four(builder, address, is_half=table.dtype == types.uint16)
                total = builder.fadd(total, builder.fmul(values, factor))
            return total

        low, high = layer(ir.Constant(_ADDRESS, 0)), layer(above)
        between = builder.fmul(_spread_four(builder, share), builder.fsub(high, low))
        target = builder.bitcast(builder.gep(result, [to]), _FOUR.as_pointer())
        builder.store(builder.fadd(low, between), target, align=4)
        return context.get_dummy_value()

    return signature, codegen


blend_texels: Callable[..., None] = intrinsic(_blend_texels)
"""Called by kernels, without `typingctx`."""


def _add_texels(typingctx, table, first, row, weights, values):
    """Add the weighted sum of four texels of `TEXEL` int8 each to values [>= TEXEL] of fp32.

    Args:
        typingctx: numba's.
        table: [T, TEXEL].
        first: the row of the first texel; the second follows it.
        row: from these to the third and the fourth.
        weights: fp32 of the four.
        values: to be changed.
    """
    signature = types.void(table, types.intp, types.intp, types.UniTuple(types.float32, 4), values)

    def codegen(context, builder, signature, arguments):
        tables, first, row, weights, sums = arguments
        data, result = (
            context.make_array(kind)(context, builder, value).data
            for kind, value in ((signature.args[0], tables), (signature.args[4], sums))
        )
        target = builder.bitcast(result, _TEXEL_FLOATS.as_pointer())
        total, next_one = builder.load(target, align=4), ir.Constant(_ADDRESS, 1)
        texels = first, builder.add(first, next_one), builder.add(first, row)
        for texel, weight in zip(
            (*texels, builder.add(texels[2], next_one)), cgutils.unpack_tuple(builder, weights), strict=True
        ):
            start = builder.gep(data, [builder.mul(texel, ir.Constant(_ADDRESS, TEXEL))])
            steps = builder.load(builder.bitcast(start, _TEXEL_BYTES.as_pointer()), align=1)
            factors = _in_every_lane(builder, weight, _TEXEL_FLOATS)
            total = builder.fadd(total, builder.fmul(builder.sitofp(steps, _TEXEL_FLOATS), factors))
        builder.store(total, target, align=4)
        return context.get_dummy_value()

    return signature, codegen


add_texels: Callable[..., None] = intrinsic(_add_texels)
"""Called by kernels, without `typingctx`."""

TEXEL = 12
"""Channels of a map of detail."""
_TEXEL_BYTES, _TEXEL_FLOATS = (ir.VectorType(of, TEXEL) for of in (ir.IntType(8), ir.FloatType()))
_FOUR = ir.VectorType(ir.FloatType(), 4)


def _load_four(builder: ir.IRBuilder, address, is_half: bool):
    if not is_half:
        return builder.load(builder.bitcast(address, _FOUR.as_pointer()), align=4)
    halves = ir.VectorType(ir.HalfType(), 4)
    return builder.fpext(builder.load(builder.bitcast(address, halves.as_pointer()), align=2), _FOUR)


def _spread_four(builder: ir.IRBuilder, value):
    return _in_every_lane(builder, value, _FOUR)


def _in_every_lane(builder: ir.IRBuilder, value, kind: ir.VectorType):
    nothing = ir.Constant(kind, ir.Undefined)
    first = builder.insert_element(nothing, value, ir.Constant(_WORD, 0))
    return builder.shuffle_vector(first, nothing, ir.Constant(ir.VectorType(_WORD, kind.count), [0] * kind.count))
