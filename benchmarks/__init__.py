"""Benchmarks: each prints what it measured, peers in the same run. Run one with `python -m benchmarks.NAME`."""
