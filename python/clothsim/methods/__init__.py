"""The time integration methods, and what theory says of them: stability regions, guaranteed step,
limiting term.
"""
