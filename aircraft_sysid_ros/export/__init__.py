"""The model of a run in the formats of other programs: what they can hold of it, and what they cannot."""
