"""Checks of a run beside its frames: what they tell is said at its end."""
