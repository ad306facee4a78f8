"""File formats of `Run.export`: ``write(clip, path)`` of a module writes files and returns them,
the one to open first.
"""
