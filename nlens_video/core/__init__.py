"""Data and conventions that every folder shares: layers, lens fit, colour, settings, errors."""
