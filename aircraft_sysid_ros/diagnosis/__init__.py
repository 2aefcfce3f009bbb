"""Compare a model with measurements, find where it fails, and which physical effect is missing."""
