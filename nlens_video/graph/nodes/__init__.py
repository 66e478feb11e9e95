"""Node types that pipeline files name, one module per family."""
