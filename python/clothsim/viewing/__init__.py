"""Views of a cloth: pictures, plots, films, pages and the live viewer."""
