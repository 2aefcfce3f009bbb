"""Changes of the trim of a long flight."""
