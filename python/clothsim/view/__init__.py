"""Looking at a cloth: pictures, plots, pages and the live viewer."""
