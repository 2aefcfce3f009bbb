"""From a log to a page that a person reads in a minute: what to trust, what it says, what to fly next."""
