"""A person's hand from pictures, or from numbers, by a base's networks and a surface of one's own."""
