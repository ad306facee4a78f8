"""Other solvers, on the same cloth."""
