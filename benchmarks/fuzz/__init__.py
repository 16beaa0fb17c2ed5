"""Fuzzing of everything that reads what comes from outside: `python -m benchmarks.fuzz`."""
