"""Which parameters may be believed: residuals, faults of sensors, changes of the aeroplane."""
