"""Views of a cloth: pictures, plots, films and pages."""
