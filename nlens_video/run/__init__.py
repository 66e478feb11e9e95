"""One run: a source opened, its frames taken through the graph, the result written."""
