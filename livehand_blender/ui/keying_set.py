"""The keying set *LiveHand*: keys bones, targets and controls of the active hand at once."""

from __future__ import annotations

import bpy

from ..rig.hand import RiggedHand, active_hand
from ..rig.keyframes import hand_channels
from .posing import has_controls


class LIVEHAND_KS_hand(bpy.types.KeyingSetInfo):
    """Key the whole pose of the active hand."""

    bl_idname = "LIVEHAND_KS_hand"
    bl_label = "LiveHand"
    bl_description = "Bones, fingertip targets and finger controls of the active LiveHand hand"

    def poll(self, context):
        """Enabled on a hand that has controls."""
        return has_controls(context)

    def iterator(self, context, keying_set):
        """Only the active hand."""
        self.generate(context, keying_set, active_hand(context))

    def generate(self, context, keying_set, data):
        """One path per channel, grouped by bone and by finger."""
        for path, group in hand_channels(RiggedHand.of(data)):
            keying_set.paths.add(data, path, index=-1, group_method="NAMED", group_name=group)


CLASSES = (LIVEHAND_KS_hand,)
