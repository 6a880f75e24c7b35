"""One simulation: run it, hold its trajectory, keep it in a folder."""
