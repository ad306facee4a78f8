"""A state in, a number out: energy, penetration, stretch."""
