"""Estimators of the aerodynamic parameters."""
