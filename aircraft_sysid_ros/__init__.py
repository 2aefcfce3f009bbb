"""Aerodynamic model identification of fixed-wing aircraft in flight, on ROS 2."""

__version__ = "0.1.0"
