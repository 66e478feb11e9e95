"""The nodes that a pipeline file can name, one module a family."""
