"""A whole run and its report."""
