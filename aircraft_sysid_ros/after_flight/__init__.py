"""What is done with a flight once it is over: one module for each command, without options and printing."""
