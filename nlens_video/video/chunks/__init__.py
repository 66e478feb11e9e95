"""Chunks: lossless parts of a result that are merged later."""
