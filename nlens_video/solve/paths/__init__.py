"""Paths of cameras from points that were followed."""
