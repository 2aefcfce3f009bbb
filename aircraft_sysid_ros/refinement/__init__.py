"""Maximum likelihood on a recorded flight: the whole aircraft model of chapter 6 fitted at once, after the flight."""
