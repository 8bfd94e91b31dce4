"""Tensors as arrays: what is copied, and what is not."""

import numpy as np
import torch
from livehand.backend.compute.cpu.arrays import whole_rows


def test_the_first_columns_of_a_matrix_come_with_the_rest_and_without_a_copy():
    matrix = torch.arange(12.0).reshape(3, 4)
    rows = whole_rows(matrix[:, :3])
    assert rows.flags.c_contiguous
    assert np.shares_memory(rows, matrix.numpy())
    np.testing.assert_array_equal(rows, matrix)


def test_any_other_part_of_a_matrix_comes_alone():
    matrix = torch.arange(12.0).reshape(3, 4)
    for values in (matrix, matrix[:, 1:3], matrix[:, ::2], matrix.T, matrix[:1].expand(2, 4), matrix[:0]):
        rows = whole_rows(values)
        assert rows.flags.c_contiguous
        np.testing.assert_array_equal(rows, values)
