"""What stills and 3D views both read of a hand, and the loading of its renderer."""
