"""The frame graph: nodes, how a pipeline file wires them, and how a stream runs through them."""
