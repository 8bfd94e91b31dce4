"""Captures of several people as one."""

from dataclasses import replace

import numpy as np
import pytest
from livehand.backend.capture.joined import first_person, joined
from livehand.backend.records.errors import LiveHandError


def test_joined_captures_keep_their_images_and_number_poses_and_cameras_on(painted_capture, tmp_path):
    other = replace(painted_capture, provenance={"made_by": "another"})
    both = joined([painted_capture, other])
    count = len(painted_capture.views)
    assert both.identities == (0, 0, 1, 1)
    assert [view.pose_index for view in both.views[count:]] == [2 + view.pose_index for view in other.views]
    assert {view.camera_index for view in both.views} == set(range(8))
    for ours, theirs in zip(both.views, [*painted_capture.views, *other.views], strict=True):
        assert np.array_equal(both.read_pixels(ours), painted_capture.read_pixels(theirs))
    assert both.provenance == {"joined": [painted_capture.provenance, {"made_by": "another"}]}
    assert first_person(both).views == both.views[:count]
    assert first_person(painted_capture) is painted_capture


def test_captures_of_other_hands_or_with_lights_are_not_joined(painted_capture, lit_capture):
    with pytest.raises(LiveHandError, match="one hand model"):
        joined([painted_capture, replace(painted_capture, hand_sha256="0" * 64)])
    with pytest.raises(LiveHandError, match="without"):
        joined([painted_capture, lit_capture])
