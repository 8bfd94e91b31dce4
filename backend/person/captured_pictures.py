"""Pictures of a capture, whose poses are known: of the built-in hand, or of another model in MANO's format."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..capture.capture import Capture, CaptureView, load_capture
from ..capture.picture import linear_to_srgb, straight
from ..hand.model import HandModel
from ..motion.capture_gate import capture_doubt
from ..records.errors import LiveHandError
from ..records.hand_picture import BACKGROUND, HAND, UNKNOWN, HandPicture, PicturedHand
from ..records.shot import HandPose
from .camera_gains import camera_log_gains
from .rig.pictures_of_rig import mirrored_camera
from .skin_masks import where_arm_may_be

_SURE_HAND, _SURE_BACKGROUND = 0.75, 0.25  # of alpha
_CAMERAS_OF_POSE = 5
_GREY = 3.0  # mean difference of a pixel's channels, of 255, below which a picture has no colours
_LEAST_HAND_PX = 50
_UNLIKE_MM = 4.0  # root mean square distance of both hands' surfaces from which on people are told
_UNLIKE_OTHERS = 2.5  # of a pose's over those of most
_FEW = 8  # poses that are named


def pictures_of_capture(
    folder: Path, model: HandModel, most: int, other: HandModel | None, log: Callable[[str], None]
) -> PicturedHand:
    """Read the pictures of a capture; its held-out poses are held out here. Those of left hands are mirrored.

    Args:
        folder: of the capture.
        model: the hand that a person is made on, right.
        most: pictures to make the person from.
        other: the capture's own hand model; None: `model`.
        log: is told what begins.

    Raises:
        LiveHandError: the capture is broken, of another hand, of two sides, or has no colours.
    """
    capture = load_capture(folder)
    _check_hand(capture, model, other)
    train = chosen_views(capture.of_split("train"), most)
    if not train:
        raise LiveHandError(f"{folder} must have images to make a person from (split train), got none")
    held_out = chosen_views(capture.of_split("novel_pose"), max(1, most // 6))
    sides = {capture.poses[view.pose_index].side for view in (*train, *held_out)}
    if len(sides) > 1:
        raise LiveHandError(f"{folder} must show hands of one side, got both; make a capture of each")
    read = [
        _picture(capture, view, is_held_out)
        for views, is_held_out in ((train, False), (held_out, True))
        for view in views
    ]
    pictures = [picture for picture in read if _has_colours(picture)]
    if not any(not picture.is_held_out for picture in pictures):
        raise LiveHandError(f"{folder} must have images in colour to make a person from, got grey ones only")
    doubt = capture_doubt(capture, other or model)
    notes = [f"check the poses: {doubt}"] if doubt else []
    notes += [] if len(pictures) == len(read) else [f"{len(read) - len(pictures)} grey pictures are left out"]
    offset_m = None
    if other is not None and other.sha256 != model.sha256:
        log(f"laying the built-in hand over '{other.name}'")
        pictures, offset_m, note = _carried_over(pictures, model, other)
        notes.append(note)
    pictures = with_gains(pictures, model)
    is_left = sides == {"left"} or capture.provenance.get("is_mirrored") is True
    return PicturedHand(tuple(pictures), "left" if is_left else "right", folder.name, offset_m, notes=tuple(notes))


def chosen_views(views: Sequence[CaptureView], most: int) -> list[CaptureView]:
    """Choose views of poses that are spread evenly, each seen by some cameras, all of which take turns."""
    of_pose: dict[int, list[CaptureView]] = {}
    for view in views:
        of_pose.setdefault(view.pose_index, []).append(view)
    if not of_pose:
        return []
    cameras = min(_CAMERAS_OF_POSE, max(len(group) for group in of_pose.values()))
    groups = list(of_pose.values())
    count = min(len(groups), max(1, round(most / cameras)))
    share = max(1, most // count)
    chosen = []
    for turn, index in enumerate(np.linspace(0, len(groups) - 1, count).round().astype(int)):
        group = groups[index]
        rolled = group[turn % len(group) :] + group[: turn % len(group)]
        steps = np.linspace(0, len(group), min(len(group), share), endpoint=False).astype(int)
        chosen += [rolled[step] for step in steps]
    return chosen[:most]


def _check_hand(capture: Capture, model: HandModel, other: HandModel | None) -> None:
    """Raise LiveHandError unless the capture's poses are those of the given hand model."""
    given = other or model
    if capture.hand_sha256 == given.sha256:
        return
    remedy = (
        "give its hand model with --hand"
        if other is None
        else "give the file with which the capture was made, byte for byte"
    )
    raise LiveHandError(
        f"{capture.folder} must be a capture of '{given.name}', got one of hand {capture.hand_sha256[:12]}...; {remedy}"
    )


def _picture(capture: Capture, view: CaptureView, is_held_out: bool) -> HandPicture:
    if view.is_linear:
        linear = capture.read_linear(view)
        alpha, rgb = linear[..., 3], linear_to_srgb(straight(linear).clip(0, 1))
        encoded = (255 * rgb).round().astype(np.uint8)
    else:
        pixels = capture.read_pixels(view)
        alpha, encoded = pixels[..., 3] / 255, pixels[..., :3]
    labels = np.full(alpha.shape, UNKNOWN, np.uint8)
    labels[alpha > _SURE_HAND], labels[alpha < _SURE_BACKGROUND] = HAND, BACKGROUND
    camera, pose = view.camera, capture.poses[view.pose_index]
    if pose.side == "left":
        encoded, labels, camera, pose = encoded[:, ::-1], labels[:, ::-1], mirrored_camera(camera), pose.mirrored()
    return HandPicture(
        view.file,
        np.ascontiguousarray(encoded),
        np.ascontiguousarray(labels),
        camera,
        pose,
        view.camera_index,
        0 if view.light is None else view.light,
        is_held_out,
        moment=view.pose_index,
    )


def _has_colours(picture: HandPicture) -> bool:
    """Tell whether a picture has colours on the hand; one without the hand does no harm."""
    skin = picture.rgb[picture.labels == HAND].astype(np.float32)
    return len(skin) < _LEAST_HAND_PX or float(np.ptp(skin, axis=1).mean()) > _GREY


def _carried_over(
    pictures: Sequence[HandPicture], model: HandModel, other: HandModel
) -> tuple[list[HandPicture], np.ndarray, str]:
    """Pose the built-in hand as the other model was; returns its own shape's offsets, and a note, too."""
    from ..rigs.model_transfer.transfer_file import stored_transfer

    first: dict[int, HandPose] = {}
    for picture in pictures:
        assert picture.moment is not None
        first.setdefault(picture.moment, picture.pose)
    transfer = stored_transfer(model, other.for_side(model.side))
    found = transfer.transferred(list(first.values()))
    pose_of = dict(zip(first, found.poses, strict=True))
    off_mm = dict(zip(first, found.deviation_mm.tolist(), strict=True))
    usual_mm = float(np.median(found.deviation_mm))
    alike = {moment for moment in first if off_mm[moment] < max(_UNLIKE_MM, _UNLIKE_OTHERS * usual_mm)}
    note = f"poses of '{other.name}' are carried over, both surfaces are {usual_mm:.1f} mm apart"
    note += "" if usual_mm < _UNLIKE_MM else ", which is much: look at the sheet"
    if len(alike) < len(first):
        wrong = [moment for moment in first if moment not in alike]
        note += f"; {len(wrong)} of {len(first)} poses are left out, whose fits no such hand can have: {_list(wrong)}"
    moved = [
        _with_arm_unknown(replace(picture, pose=pose_of[picture.moment]), model)
        for picture in pictures
        if picture.moment in alike
    ]
    return moved, found.offset_m, note


def _list(poses: Sequence[int]) -> str:
    few = ", ".join(map(str, poses[:_FEW]))
    return few if len(poses) <= _FEW else f"{few}, ..."


def _with_arm_unknown(picture: HandPicture, model: HandModel) -> HandPicture:
    """Say nothing of the arm: masks of a hand without one end at its wrist."""
    labels = picture.labels.copy()
    labels[where_arm_may_be(picture.pose, picture.camera, model) & (labels == BACKGROUND)] = UNKNOWN
    return replace(picture, labels=labels)


def with_gains(pictures: Sequence[HandPicture], model: HandModel) -> list[HandPicture]:
    """Give pictures their cameras' gains, as their poses tell them: the better these are, the better they do."""
    gains = camera_log_gains(pictures, model)
    return [replace(picture, log_gain=gains[picture.camera_index]) for picture in pictures]
