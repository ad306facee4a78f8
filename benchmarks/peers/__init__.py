"""Other programs on the same cloth: vectorised NumPy, numba, SciPy, diffrax."""
