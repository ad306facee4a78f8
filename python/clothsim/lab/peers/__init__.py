"""Solvers of other packages, for comparison on equal cloths."""
