"""The aircraft of (6.1)-(6.25) in docs/references.md as a dynamic system with its Kalman filter."""
