"""The aircraft of chapter 6 of the summary as a dynamic system with its Kalman filter."""
