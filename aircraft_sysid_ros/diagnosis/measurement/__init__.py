"""Effects in the measurement, tried before aerodynamics is blamed."""
