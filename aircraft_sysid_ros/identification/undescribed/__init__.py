"""What no aircraft file says of the sensors, and a flight may show."""
