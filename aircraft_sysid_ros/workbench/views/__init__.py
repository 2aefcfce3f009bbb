"""A run as figures and tables: pure functions that know nothing of the web."""
