"""What the hops say about the ground, and what to do about it."""
