"""One table of what hopper costs and gets right, each row beside its peer in the same run."""
