"""The flight software: what runs on the robot. Imports hal and nothing else of this project."""

from hal.compiled import prefer

COMPILED = prefer(__name__, __path__)
"""Whether what `hopper compile` translates runs as machine code."""
