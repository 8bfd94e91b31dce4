"""A walk over faces finds the parts that scipy finds, and the winding that was hidden."""

import numpy as np
import pytest
from livehand.backend.contact.oriented_mesh import walked_faces
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components


@pytest.mark.parametrize("edges", [0, 60, 300])
def test_parts_and_winding_of_any_graph(edges):
    random, count = np.random.default_rng(edges), 200
    first, second = random.integers(0, count, (2, edges))
    hidden = random.random(count) > 0.5
    label, flips = walked_faces(first, second, hidden[first] == hidden[second], count)
    parts, expected = connected_components(
        coo_matrix((np.ones(edges), (first, second)), (count, count)), directed=False
    )
    assert label.max() + 1 == parts
    np.testing.assert_array_equal(
        np.unique(expected, return_index=True)[1][expected], [np.argmax(label == k) for k in label]
    )
    roots = np.array([np.argmax(label == k) for k in range(parts)])
    np.testing.assert_array_equal(flips, hidden ^ hidden[roots][label])


def test_a_long_strip_is_one_part():
    first = np.arange(4999)
    label, flips = walked_faces(first, first + 1, np.zeros(4999, bool), 5000)
    assert not label.any()
    np.testing.assert_array_equal(flips, np.arange(5000) % 2 == 1)
