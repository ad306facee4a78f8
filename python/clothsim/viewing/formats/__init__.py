"""File formats of `Run.export`. There is one module per family, and each module has ``write(clip, path)``.

``write`` writes the file `path`, and further files beside it. It returns all paths, with the file to open first. The
folder is empty and temporary: `view.export` moves the files into place.
"""
