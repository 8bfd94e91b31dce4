"""Motions as `.npz`: LiveHand's own, MANO's parameters and SMPL-X' of a body that stands still.

MANO's and SMPL-X' angles are absolute (`flat_hand_mean=True` in the package smplx) unless the user wants them to count
from MANO's mean pose.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...geometry.rotation import axis_angle_to_matrix, matrix_to_axis_angle
from ...system.files import replacing
from ...system.readers import npz_bytes
from ..formats.own import write_motion
from ..mano_basis import require_basis
from ..spaces import TO_BLENDER
from .take import Take, TakenHand
from .writer import WriteOptions, Writer

_SAME_SIZE = 1e-4
_NO_SIZE = "the hand is {:.3g} times its model's size, which the format cannot hold"
_NO_ARM = "the forearm's bend, which the format does not hold, is left out"
_NO_PLACE = "the wrist's place and the hand's shape, which are a body's in SMPL-X, are left out"
_BODY_JOINTS = 21
_WRISTS = {"left": 19, "right": 20}  # among the 21 joints of body_pose


def _write_own(take: Take, path: Path, options: WriteOptions) -> tuple[str, ...]:
    hand = take.only("LiveHand's own format")
    write_motion(hand.own or hand.motion, path)
    return ()


def _write_mano(take: Take, path: Path, options: WriteOptions) -> tuple[str, ...]:
    """Write `poses` [T, 48], `betas`, `trans` [T, 3] m, `side`, `fps`, `axes` and `flat_hand_mean`."""
    hand = take.only("MANO's parameters")
    motion = hand.motion
    poses = motion.theta.reshape(-1, 48).copy()
    if options.counts_from_mean:
        poses[:, 3:] -= require_basis(options.basis, hand.side, "angles that count from MANO's mean").mean.ravel()
    _write(
        path,
        {
            "poses": poses,
            "betas": motion.beta,
            "trans": motion.transl,
            "side": np.array(hand.side),
            "fps": np.array(take.fps),
            "axes": np.array("z_up"),
            "flat_hand_mean": np.array(not options.counts_from_mean),
            "first": np.array(hand.first),
        },
    )
    return _losses(hand)


def _write_smplx(take: Take, path: Path, options: WriteOptions) -> tuple[str, ...]:
    """Write `global_orient`, `body_pose` [T, 63], the hands' poses [T, 45] and the rate, as smplx names them."""
    stands = TO_BLENDER["y_up"]  # a body's own Y is the world's Z
    arrays = {
        "global_orient": np.tile(matrix_to_axis_angle(stands), (take.count, 1)),
        "transl": np.zeros((take.count, 3)),
        "gender": np.array("neutral"),
        "mocap_frame_rate": np.array(take.fps),
        "flat_hand_mean": np.array(True),
    }
    body = np.zeros((take.count, _BODY_JOINTS, 3))
    for hand in take.hands:
        theta = hand.held(take.count).motion.theta
        body[:, _WRISTS[hand.side]] = matrix_to_axis_angle(stands.T @ axis_angle_to_matrix(theta[:, 0]))
        arrays[f"{hand.side}_hand_pose"] = theta[:, 1:].reshape(-1, 45)
    _write(path, arrays | {"body_pose": body.reshape(-1, 63)})
    losses = {loss for hand in take.hands for loss in _losses(hand)}
    return (_NO_PLACE, *sorted(losses - {loss for loss in losses if "size" in loss}))


def _losses(hand: TakenHand) -> tuple[str, ...]:
    """Say what of a hand is neither pose nor shape nor place."""
    losses = [] if abs(hand.scale - 1) < _SAME_SIZE else [_NO_SIZE.format(hand.scale)]
    return (*losses, *((_NO_ARM,) if hand.motion.forearm.any() else ()))


def _write(path: Path, arrays: dict[str, np.ndarray]) -> None:
    with replacing(path) as temporary:
        temporary.write_bytes(npz_bytes(arrays))


OWN = Writer("livehand", "LiveHand", (".npz",), _write_own)
MANO = Writer("mano", "MANO", (".npz",), _write_mano)
SMPLX = Writer("smplx", "SMPL-X", (".npz",), _write_smplx)
