"""Solves symmetric positive definite block systems in which each frame is tied to the next two."""

from __future__ import annotations

import numpy as np


def solve_pentadiagonal(
    diagonal: np.ndarray, next_ties: np.ndarray, second_ties: np.ndarray, right: np.ndarray
) -> np.ndarray:
    """Solve for [T, n] by block elimination, two frames at a time.

    Args:
        diagonal: [T, n, n] blocks of each frame.
        next_ties: [T - 1, n] diagonals of the blocks above them, between each frame and the next.
        second_ties: [T - 2, n] the same between each frame and the one after next.
        right: [T, n].

    Raises:
        numpy.linalg.LinAlgError: the matrix is singular.
    """
    count, n = right.shape
    pairs = (count + 1) // 2
    k = np.arange(n)
    blocks = np.zeros((pairs, 2 * n, 2 * n))
    blocks[:, k, k] = blocks[:, n + k, n + k] = 1  # for the frame that an odd count lacks
    blocks[:, :n, :n] = diagonal[::2]
    blocks[: count // 2, n:, n:] = diagonal[1::2]
    inner = next_ties[::2]
    blocks[: len(inner), k, n + k] = blocks[: len(inner), n + k, k] = inner
    ties = np.zeros((max(pairs - 1, 0), 2 * n, 2 * n))
    ties[: len(next_ties[1::2]), n + k[:, None], k[:, None]] = next_ties[1::2, :, None]
    ties[: len(second_ties[::2]), k[:, None], k[:, None]] = second_ties[::2, :, None]
    ties[: len(second_ties[1::2]), n + k[:, None], n + k[:, None]] = second_ties[1::2, :, None]
    wanted = np.zeros((pairs, 2 * n))
    wanted[:, :n] = right[::2]
    wanted[: count // 2, n:] = right[1::2]
    return _solve_tridiagonal(blocks, ties, wanted).reshape(2 * pairs, n)[:count]


def _solve_tridiagonal(blocks: np.ndarray, ties: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solve for [P, m] with blocks [P, m, m] and the ties [P - 1, m, m] above them."""
    eliminated = np.empty((*right.shape, ties.shape[-1] + 1 if len(ties) else 1))
    block, rest = blocks[0], right[0]
    for index in range(len(blocks)):
        if index:
            above = ties[index - 1]
            block = blocks[index] - above.T @ eliminated[index - 1, :, 1:]
            rest = right[index] - above.T @ eliminated[index - 1, :, 0]
        columns = np.column_stack([rest, ties[index]]) if index < len(ties) else rest[:, None]
        eliminated[index, :, : columns.shape[1]] = np.linalg.solve(block, columns)
    solution = np.empty_like(right)
    solution[-1] = eliminated[-1, :, 0]
    for index in range(len(blocks) - 2, -1, -1):
        solution[index] = eliminated[index, :, 0] - eliminated[index, :, 1:] @ solution[index + 1]
    return solution
