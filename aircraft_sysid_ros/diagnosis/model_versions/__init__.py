"""Versions of the model of a run, and what makes one of another."""
