"""A real person's hand from pictures: poses, light and skin, by an avatar's networks and a surface of one's own."""
