"""Cameras of plates: solved or tracked paths, and the files that hold them."""
