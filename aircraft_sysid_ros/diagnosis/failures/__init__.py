"""Controls and engines that fail during a flight, from what any flight measures: forces, rates, speed and inputs."""
