"""Put a rendered, animated object into real footage as if the same lens had filmed it."""

__version__ = "0.1.0"
