"""Tools on the ground: recordings, simulation, diagnosis, reports."""
