"""The console: what the robot tells, in the browser or in the terminal, live over the link or back from a log."""
