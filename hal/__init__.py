"""The hardware abstraction: device contracts, readings, errors, configuration, boards opened by name."""
