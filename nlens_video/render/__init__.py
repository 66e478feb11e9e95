"""Renderers of the object: colour, depth and coverage of a posed scene seen by a camera."""
