"""Bounds what a pickle may ask for before it is loaded: its opcodes are walked without running any of them.

Loading can crash or fill the memory before any class is named: the hash of deeply nested tuples overflows the C stack,
and a large memo index allocates as many places.
"""

from __future__ import annotations

import pickletools

from ..records.errors import LiveHandError

MOST_OPCODES = 2_000_000
"""Walked in a few seconds; a pickle of arrays has a few for each array."""
DEEPEST = 50
_MARK = -1
_PUTS, _GETS = ("PUT", "BINPUT", "LONG_BINPUT"), ("GET", "BINGET", "LONG_BINGET")
_TUPLES = ("TUPLE", "TUPLE1", "TUPLE2", "TUPLE3")


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
        if name in _PUTS or name == "MEMOIZE":
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
            _step(stack, opcode)


def _step(stack: list[int], opcode: pickletools.OpcodeInfo) -> None:
    """What an opcode takes from the stack and puts there."""
    taken = _taken(stack, opcode)
    depth = max(taken, default=0)
    if opcode.name in _TUPLES:
        depth += 1
        if depth > DEEPEST:
            raise LiveHandError(
                f"a pickle must nest tuples at most {DEEPEST} deep, got more; save plain arrays instead"
            )
    elif pickletools.pytuple not in opcode.stack_after and pickletools.anyobject not in opcode.stack_after:
        depth = 0
    stack.extend([depth] * len(opcode.stack_after))


def _taken(stack: list[int], opcode: pickletools.OpcodeInfo) -> list[int]:
    before = list(opcode.stack_before)
    taken: list[int] = []
    if pickletools.markobject in before:
        while (depth := stack.pop()) != _MARK:
            taken.append(depth)
        before = before[: before.index(pickletools.markobject)]
    taken += [stack.pop() for _ in before]
    return taken
