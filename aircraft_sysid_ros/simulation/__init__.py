"""Flights with known truth: rigid-body simulation, manoeuvres, wind, sensors, and the recording of them."""
