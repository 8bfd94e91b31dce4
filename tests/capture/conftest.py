"""What the tests of plans share: joint angles that are relieved once, though plan after plan asks for them."""

from functools import cache

import numpy as np
import pytest
from livehand.backend.hand import penetration


@pytest.fixture(scope="session")
def relieved_once():
    """Plans find the relieved angles of a pose that another plan has drawn, too: they are most of a plan's time."""
    relieve = penetration.relieved_angles
    given = {}

    @cache
    def relieved(sha256, side, angles):
        return relieve(*given[sha256, side], np.frombuffer(angles).reshape(15, 3), given["axes", sha256, side])

    def once(parts, model, angles_deg, axes):
        key = model.sha256, model.side
        given.setdefault(key, (parts, model))
        given.setdefault(("axes", *key), axes)
        return relieved(*key, angles_deg.tobytes()).copy()

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(penetration, "relieved_angles", once)
        yield
