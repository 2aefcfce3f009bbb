"""States and controls in, samples of the measured coefficients out."""
