"""First step of the two-step method: state, IMU biases and wind from IMU, GPS and air data."""
