"""Accuracy of the composite, of the rendered object and of whole clips against ground truth."""
