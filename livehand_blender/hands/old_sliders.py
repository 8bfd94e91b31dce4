"""Sliders of earlier versions play with LiveHand only: hands get sliders of their own, to which all references change.

Hands that are linked from files of earlier versions stay as they are.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

import bpy
from bpy.app.handlers import persistent

from ..rig.sliders import FORWARD, SLIDERS, Animated, add_sliders, has_all_sliders, slider_path
from ..scene.data_blocks import all_data
from ..scene.handlers import add_handlers, remove_handlers

_FORWARDED = re.compile(rf"^{re.escape(FORWARD)}({'|'.join(map(re.escape, SLIDERS))})(?!\w)")
_Paths = dict[str, str]


def renew_sliders() -> None:
    """Bring the hands of the file up to date, and everything in it that refers to their sliders."""
    hands = {thing for thing in bpy.data.objects if thing.livehand.is_hand}
    for hand in (hand for hand in hands if hand.library is None and hand.override_library is None):
        renamed = {} if hand.livehand.has_sliders else _keep_namesakes(hand)
        if not has_all_sliders(hand):
            add_sliders(hand)
        if renamed:
            _renew_references({hand}, _actions(hand), renamed)
    new = {hand for hand in hands if hand.livehand.has_sliders}
    if new:
        # An action that no hand uses may yet be given to any.
        others = {action for hand in hands - new for action in _actions(hand)}
        _renew_references(new, set(bpy.data.actions) - others, {})


def renew_appended() -> None:
    """Bring hands up to date that have come from files of earlier versions."""
    if any(thing.livehand.is_hand and not thing.livehand.has_sliders for thing in bpy.data.objects):
        renew_sliders()


def _keep_namesakes(hand: bpy.types.Object) -> _Paths:
    """Rename the user's own properties that have a slider's name; returns their old and new data paths."""
    kept = {name: f"{name} (own)" for name in SLIDERS if name in hand}
    for name, new_name in kept.items():
        hand[new_name] = hand.pop(name)
    return {slider_path(name): slider_path(new_name) for name, new_name in kept.items()}


def _renew_references(hands: set[bpy.types.Object], actions: set[bpy.types.Action], renamed: _Paths) -> None:
    """Change the data paths by which actions, drivers and keying sets refer to the hands' sliders."""
    for curves in (curves for action in actions for curves in _collections_of_curves(action)):
        for curve in list(curves):
            if path := _new_path(curve, renamed):
                _rename_curve(curves, curve, path)
    for reference in _drivers_and_targets(hands):
        if path := _new_path(reference, renamed):
            reference.data_path = path


def _new_path(reference, renamed: _Paths) -> str:
    """The data path that a reference gets; empty: its own stays."""
    path = renamed.get(reference.data_path) or _FORWARDED.sub(lambda found: slider_path(found[1]), reference.data_path)
    return path if path != reference.data_path else ""


def _rename_curve(curves, curve: bpy.types.FCurve, path: str) -> None:
    """If there is a curve of that path, it gets the keys, and this one is removed."""
    known = curves.find(path, index=curve.array_index)
    if known is None:
        curve.data_path = path
        return
    for key in curve.keyframe_points:
        copy = known.keyframe_points.insert(*key.co)
        for name in ("interpolation", "easing", "handle_left_type", "handle_right_type", "handle_left", "handle_right"):
            setattr(copy, name, getattr(key, name))
    known.update()
    curves.remove(curve)


def _drivers_and_targets(hands: set[bpy.types.Object]) -> Iterator:
    """What has a data path into one of these hands, apart from actions."""
    for owner in _local_ids():
        for curve in owner.animation_data.drivers if owner.animation_data else ():
            if owner in hands:
                yield curve
            targets = (target for variable in curve.driver.variables for target in variable.targets)
            yield from (target for target in targets if target.id in hands)
    for scene in bpy.data.scenes:
        paths = (path for keying_set in scene.keying_sets for path in keying_set.paths)
        yield from (path for path in paths if path.id in hands)


def _actions(hand: bpy.types.Object) -> set[bpy.types.Action]:
    animation = hand.animation_data
    if animation is None:
        return set()
    strips = [strip.action for track in animation.nla_tracks for strip in track.strips]
    return {action for action in (animation.action, *strips) if action is not None}


def _collections_of_curves(action: bpy.types.Action) -> list:
    if not hasattr(action, "layers"):  # Blender 4.2 and 4.3
        return [action.fcurves]
    return [bag.fcurves for layer in action.layers for strip in layer.strips for bag in strip.channelbags]


def _local_ids() -> Iterator[bpy.types.ID]:
    """Everything in the file that can have drivers."""
    for thing in all_data():
        if thing.library is None and hasattr(thing, "animation_data"):
            yield thing
            if getattr(thing, "node_tree", None) is not None:
                yield thing.node_tree


@persistent
def _renew(*_) -> None:
    """After a file was opened, and before one is saved."""
    renew_sliders()


@persistent
def _renew_animated(*_) -> None:
    """After each change of frame or file: what a script has just keyed by an earlier name."""
    if Animated.by_forward:
        renew_sliders()
        Animated.by_forward = False


_WATCHED = (
    ("load_post", _renew),
    ("save_pre", _renew),
    ("frame_change_post", _renew_animated),
    ("depsgraph_update_post", _renew_animated),
)


def watch_sliders() -> None:
    """Renew sliders from now on."""
    add_handlers(_WATCHED)


def stop_watching() -> None:
    """Undo `watch_sliders`."""
    remove_handlers(_WATCHED)
