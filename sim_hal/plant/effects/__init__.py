"""One small class for each piece of physics that a plant may have."""
