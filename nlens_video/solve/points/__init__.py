"""Points of pictures: where they are seen, and what surrounds them."""
