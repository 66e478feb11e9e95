"""Adapters for other programs: each calls the three functions of `contract`."""
