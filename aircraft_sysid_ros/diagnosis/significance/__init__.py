"""What chance does: noise, replicas of the flight, and where a residual is more than that."""
