"""Second step of the two-step method: measured coefficients, regressors, online parameters."""
