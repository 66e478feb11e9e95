"""What nodes are made of: ports, conditions, the context, the object on a frame."""
