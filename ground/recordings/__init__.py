"""Recordings of runs, and their containers."""
