"""Blind cases: rigs with something hidden in them, drawn at random, and what a diagnosis makes of them."""
