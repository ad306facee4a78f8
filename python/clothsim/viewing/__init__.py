"""Looking at a cloth: pictures, plots, films, pages and the live viewer."""
