"""The former name of `mavlink_simulator`."""
