"""ONNX sessions of the shipped networks, and where their weights lie."""
