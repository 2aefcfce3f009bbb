"""The flight that is judged: what was measured, reconstructed with all of it known."""
