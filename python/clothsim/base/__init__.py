"""Helpers that know nothing of cloth: checks of arguments, extras, files, progress."""
