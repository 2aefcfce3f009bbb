"""A maker of flights from strip theory, which shares nothing with the simulator, the model and the replicas."""
