"""Calibration of sensors from a flight, by the two-stage batch estimator: probe, magnetometer, data compatibility."""
