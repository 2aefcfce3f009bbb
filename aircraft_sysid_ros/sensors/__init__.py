"""What sensors show of a known motion: noise, delays, errors of the instruments."""
