"""Calibration of the simulated soils on published dissipation."""
