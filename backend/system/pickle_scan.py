"""Bounds what a pickle may ask for before it is loaded: its opcodes are walked without running any of them.

Loading can crash or fill the memory before any class is named: the hash of deeply nested tuples overflows the C stack,
and a large memo index allocates as many slots.
"""

from __future__ import annotations

import pickletools
from typing import NamedTuple

from ..records.errors import LiveHandError

MOST_OPCODES = 1_000_000
"""Walked in a few seconds; a pickle of arrays has a few for each array."""
DEEPEST = 50
_MARK = -1
_PUTS, _GETS = ("PUT", "BINPUT", "LONG_BINPUT", "MEMOIZE"), ("GET", "BINGET", "LONG_BINGET")


class _Effect(NamedTuple):
    """What an opcode does to the stack.

    Attributes:
        clears_mark: takes everything down to the last mark.
        takes: how many values it takes, below the mark if it clears one.
        gives: how many values it puts there.
        deepens: how much deeper the result nests than what was taken; None if it is no tuple.
    """

    clears_mark: bool
    takes: int
    gives: int
    deepens: int | None


def _effect(opcode: pickletools.OpcodeInfo) -> _Effect:
    before, after = list(opcode.stack_before), opcode.stack_after
    clears_mark = pickletools.markobject in before
    takes = before.index(pickletools.markobject) if clears_mark else len(before)
    keeps = pickletools.pytuple in after or pickletools.anyobject in after
    return _Effect(clears_mark, takes, len(after), 1 if "TUPLE" in opcode.name else 0 if keeps else None)


_EFFECTS = {opcode.name: _effect(opcode) for opcode in pickletools.opcodes}


def scan_pickle(raw: bytes) -> None:
    """Walk the opcodes of a pickle.

    Raises:
        LiveHandError: it has too many, nests tuples too deeply, or names a place in the memo far beyond its size.
        ValueError, IndexError, KeyError, StopIteration: it is damaged.
    """
    stack: list[int] = []  # how deeply tuples nest in each value; -1 for a mark
    memo: dict[int, int] = {}
    for number, (opcode, argument, _) in enumerate(pickletools.genops(raw)):
        if number >= MOST_OPCODES:
            raise LiveHandError(f"a pickle must have at most {MOST_OPCODES} opcodes; save plain arrays as .npz instead")
        name = opcode.name
        if name in _PUTS:
            place = len(memo) if argument is None else int(argument)
            if not 0 <= place <= number:
                raise LiveHandError(f"a pickle's memo must be filled in order, got index {place}; save it again")
            memo[place] = next(depth for depth in reversed(stack) if depth != _MARK)
        elif name in _GETS:
            stack.append(memo[int(argument or 0)])
        elif name == "DUP":
            stack.append(stack[-1])
        elif name == "MARK":
            stack.append(_MARK)
        else:
            _apply(_EFFECTS[name], stack)


def _apply(effect: _Effect, stack: list[int]) -> None:
    deepest = 0
    if effect.clears_mark:
        while (depth := stack.pop()) != _MARK:
            deepest = max(deepest, depth)
    for _ in range(effect.takes):
        deepest = max(deepest, stack.pop())
    depth = 0 if effect.deepens is None else deepest + effect.deepens
    if depth > DEEPEST:
        raise LiveHandError(f"a pickle must nest tuples at most {DEEPEST} deep; save plain arrays as .npz instead")
    for _ in range(effect.gives):
        stack.append(depth)
