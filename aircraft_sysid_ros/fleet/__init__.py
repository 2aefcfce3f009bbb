"""Many flights at once, and what changes from flight to flight."""
