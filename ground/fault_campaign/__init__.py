"""Random faults through whole simulated missions, and what became of them."""
