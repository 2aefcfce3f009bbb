"""A simulated autopilot: flies a simulator and speaks MAVLink as ArduPlane, with faults of link and clock."""
