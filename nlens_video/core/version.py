"""The package's version, where it is defined."""

VERSION = "0.1.0"
