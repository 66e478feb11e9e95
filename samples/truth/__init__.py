"""Ground truth for the lens: random scenes through a known thin lens (see README.md)."""
