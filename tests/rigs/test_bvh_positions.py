"""Translations of BVH joints that are zeros or changes get their OFFSETs; places stay."""

import numpy as np
import pytest
from livehand.backend.records.errors import LiveHandError
from livehand.backend.rigs.bvh_positions import with_offsets

CHANNELS = "6 Xposition Yposition Zposition Zrotation Xrotation Yrotation"


def bvh(positions, rotation=20.0):
    """A root and a joint with an end, of two frames with these translations [2, 3] of the joint."""
    frames = "\n".join(
        " ".join(map(str, [0, 90, 0, 0, 0, 0, *position, rotation, 0, 0])) for position in np.array(positions).tolist()
    )
    return (
        f"HIERARCHY\nROOT Hips\n{{\n OFFSET 0 90 0\n CHANNELS {CHANNELS}\n JOINT Hand\n {{\n  OFFSET -4 3 0\n"
        f"  CHANNELS {CHANNELS}\n  End Site\n  {{\n   OFFSET 1 0 0\n  }}\n }}\n}}\n"
        f"MOTION\nFrames: 2\nFrame Time: 0.0333\n{frames}\n"
    )


def frames_of(text):
    return np.array([line.split() for line in text.splitlines()[-2:]], float)


def test_zeros_and_changes_get_the_offset():
    for given, wanted in (
        ([[0, 0, 0]] * 2, [[-4, 3, 0]] * 2),
        ([[0, 0, 0.5], [0, 0.2, 0]], [[-4, 3, 0.5], [-4, 3.2, 0]]),
    ):
        text = with_offsets(bvh(given))
        np.testing.assert_allclose(frames_of(text)[:, 6:9], wanted)
        np.testing.assert_allclose(frames_of(text)[:, :6], [[0, 90, 0, 0, 0, 0]] * 2)
        np.testing.assert_allclose(frames_of(text)[:, 9], 20)
        assert text.partition("MOTION")[0] == bvh(given).partition("MOTION")[0]
        assert with_offsets(text) is None


def test_places_stay():
    assert with_offsets(bvh([[-4, 3, 0], [-4.2, 3, 0.1]])) is None
    assert with_offsets(bvh([[-9, 8, 0]] * 2)) is None  # far from both: as the file says


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("MOTION", "MOVE"), "must have a MOTION"),
        (("Frame Time: 0.0333", ""), "must have a Frame Time"),
        (("OFFSET -4 3 0", "OFFSET -4 x 0"), "must hold numbers"),
        (("0 90 0 0 0 0 0", "0 90 0 0 0 0 0 7"), "must have 12 numbers"),
    ],
)
def test_malformed_files_are_refused(change, message):
    with pytest.raises(LiveHandError, match=message):
        with_offsets(bvh([[0, 0, 0]] * 2).replace(*change))
