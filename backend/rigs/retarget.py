"""Retargets another rig's motion to theta and transl of a hand model: its bones point where the rig's do.

The rest poses tell how each bone is turned about itself. A rest pose that is no hand's (fingers that point anywhere, as
in files of trackers) tells nothing; then the joints' positions in each frame do.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..geometry.rotation import matrix_to_axis_angle
from ..motion.motion import HandMotion
from ..motion.spaces import rest_wrists
from ..records.errors import LiveHandError
from ..records.side import Side
from .natural_range import local_theta, more_natural
from .rest_alignment import HandAtRest, RestAlignment, place_hand
from .source_skeleton import unit

_MIN_STRAIGHTNESS = 0.3  # the median cosine between a finger's last bones, if the last one's tail is where it points


@dataclass(frozen=True)
class SourceMotion:
    """T poses of the 16 mapped bones of another rig, in the world.

    Attributes:
        frames: [T, 16, 3, 3] posed `SourceSkeleton.frames`: rotations whose columns are a bone's X, Y and Z; of joints
            without a bone, those of the bone that they move with.
        wrists: [T, 3] m, heads of the wrist's bone.
        fps: frames per second; None if unknown.
        side: which hand.
        nodes: [T, 21, 3] m as `source_nodes` returns them; None if unknown.
        ends: [T, 5, 3] m as `source_ends` returns them; None if unknown.
        forearms: [T, 3, 3] posed frames of the forearm's bone; None if the rig has none.

    Raises:
        LiveHandError: shapes disagree, or a number is not finite.
    """

    frames: np.ndarray
    wrists: np.ndarray
    fps: float | None
    side: Side
    nodes: np.ndarray | None = None
    ends: np.ndarray | None = None
    forearms: np.ndarray | None = None

    def __post_init__(self):
        count = len(self.wrists)
        if self.frames.shape != (count, 16, 3, 3) or self.wrists.shape != (count, 3):
            raise LiveHandError(
                f"frames must be [T, 16, 3, 3] and wrists [T, 3], got {list(self.frames.shape)} and "
                f"{list(self.wrists.shape)}"
            )
        forearms = np.zeros(0) if self.forearms is None else self.forearms
        if not all(np.isfinite(values).all() for values in (self.frames, self.wrists, forearms)):
            raise LiveHandError("the other rig's pose must be finite, got NaN or infinity; repair its animation")

    def scaled(self, factor: float) -> SourceMotion:
        """Scale the motion to another unit."""
        nodes = None if self.nodes is None else self.nodes * factor
        ends = None if self.ends is None else self.ends * factor
        return replace(self, wrists=self.wrists * factor, nodes=nodes, ends=ends)


def retarget(source: SourceMotion, alignment: RestAlignment) -> HandMotion:
    """Compute the motion in Blender's world of a hand of the alignment's shape; the object carries its scale."""
    since_rest = source.frames @ alignment.frames.swapaxes(1, 2)  # rotations in the world
    wrists = source.wrists + since_rest[:, 0] @ (alignment.wrist - alignment.heads[0])
    motion = _motion(source, alignment, since_rest @ alignment.rotations, wrists)
    nodes, ends = source.nodes, source.ends
    if nodes is None or ends is None:
        return motion
    return more_natural(alignment.model, motion, lambda: _by_positions(source, nodes, ends, alignment))


def _by_positions(source: SourceMotion, nodes: np.ndarray, ends: np.ndarray, alignment: RestAlignment) -> HandMotion:
    """Compute the motion from the joints' positions alone."""
    nodes = _with_tips(nodes, ends)
    hand = HandAtRest.of(alignment.model, alignment.shape)
    placed = [place_hand(hand, *pose) for pose in zip(nodes, ends, strict=True)]
    rotations, wrists = (np.array(values) for values in zip(*placed, strict=True))
    return _motion(source, alignment, rotations, wrists)


def _with_tips(nodes: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Set the last bones' ends [T, 5, 3] as missing tips of nodes [T, 21, 3], where they mostly continue fingers."""
    nodes = nodes.copy()
    for finger in np.flatnonzero(np.isnan(nodes[0, 4::4, 0])):
        before, last = nodes[:, 4 * finger + 2], nodes[:, 4 * finger + 3]
        if np.median((unit(ends[:, finger] - last) * unit(last - before)).sum(-1)) > _MIN_STRAIGHTNESS:
            nodes[:, 4 * finger + 4] = ends[:, finger]
    return nodes


def _motion(source: SourceMotion, alignment: RestAlignment, rotations: np.ndarray, wrists: np.ndarray) -> HandMotion:
    beta = alignment.shape.beta
    transl = wrists - rest_wrists(alignment.model, beta)
    forearm = _forearms(source, alignment, rotations[:, 0])
    return HandMotion(local_theta(rotations), beta, transl, source.fps, source.side, forearm)


def _forearms(source: SourceMotion, alignment: RestAlignment, hands: np.ndarray) -> np.ndarray:
    """Compute [T, 3] axis-angle, rad, of the forearm against the hand, which is turned by hands [T, 3, 3] in the world.

    Without a forearm, [3] zeros.
    """
    if source.forearms is None or alignment.forearm is None:
        return np.zeros(3)
    arms = source.forearms @ alignment.forearm.frame.T @ alignment.forearm.rotation
    return matrix_to_axis_angle(hands.swapaxes(1, 2) @ arms)
