"""One law in each file: a function of the flight that returns findings, or relations between its signals."""
