"""The search in flight, in a process of its own."""
