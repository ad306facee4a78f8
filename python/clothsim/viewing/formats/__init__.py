"""File formats of `Run.export`, one module a family; each has ``write(clip, path)``.

``write`` writes the file `path`, and others beside it in the same folder, and returns them all, the
file to open first. The folder is empty and temporary: `view.export` moves the files into place.
"""
