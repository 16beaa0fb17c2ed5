"""The physics: plant structures, effects, and the engine that integrates them."""
