"""The lens read off the whole ground at once by a network."""
