"""The simulated robot: plant physics, and simulated devices on top of it."""
