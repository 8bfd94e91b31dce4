"""LiveHand for Blender: pose a hand in Blender, get photoreal frames back.

The repository root is at once the Blender extension `livehand` and the pip package `livehand`. Nothing heavy is
imported here, so that listing add-ons, or running a command that needs no Blender, costs nothing.
"""


def register():
    """Called by Blender when the extension is enabled."""
    from . import livehand_blender

    livehand_blender.register()


def unregister():
    """Called by Blender when the extension is disabled, and at exit."""
    from . import livehand_blender

    livehand_blender.unregister()
