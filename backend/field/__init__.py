"""The radiance field over canonical surface coordinates."""
