"""The time integration methods, and what theory says of them: stability regions, the stable step,
limiting term.
"""
