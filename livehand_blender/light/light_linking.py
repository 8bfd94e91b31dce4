"""Light linking: the collection that limits a lamp to some objects, or keeps it off them."""

from __future__ import annotations

from dataclasses import dataclass

import bpy


@dataclass(frozen=True)
class LinkRule:
    """Which objects a lamp is linked to.

    Attributes:
        included: full names; None: every object that is not excluded.
        excluded: full names.
    """

    included: frozenset[str] | None = None
    excluded: frozenset[str] = frozenset()

    @classmethod
    def of(cls, collection: bpy.types.Collection | None) -> LinkRule:
        """Read the rule that a receiver or blocker collection states; None: no rule."""
        if collection is None:
            return cls()
        states: dict[str, str] = {}
        _collect(collection.original, None, states)
        included = frozenset(name for name, state in states.items() if state == "INCLUDE")
        excluded = frozenset(name for name, state in states.items() if state == "EXCLUDE")
        return cls(included or None, excluded)

    def holds(self, name: str) -> bool:
        """Return whether the lamp is linked to the object of this full name."""
        return name not in self.excluded and (self.included is None or name in self.included)


def _collect(collection: bpy.types.Collection, inherited: str | None, states: dict[str, str]) -> None:
    """Collect the state of each object: its own entry's, else that of the outermost collection inside that holds it."""
    for entry, child in zip(collection.collection_children, collection.children, strict=True):
        _collect(child, inherited or entry.light_linking.link_state, states)
    for entry, thing in zip(collection.collection_objects, collection.objects, strict=True):
        states[thing.name_full] = inherited or entry.light_linking.link_state
