"""Look development: the teacher's hand in a key light, and its figures."""
