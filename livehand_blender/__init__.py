"""The Blender side of LiveHand: everything that touches bpy.

bpy is imported only when Blender registers the extension, so that the `livehand` command starts without Blender.
"""


def register():
    """Register classes, properties, menus and the render engine."""
    from . import registration

    registration.register()


def unregister():
    """Remove everything `register` added, in reverse order."""
    from . import registration

    registration.unregister()
