"""The simulated robot: plant physics, and simulated devices on top of it."""

from hal.compiled import prefer

COMPILED = prefer(__name__, __path__)
"""Whether what `hopper compile` translates runs as machine code."""
