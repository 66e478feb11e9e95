"""Accuracy of the CoC and of the lens fit against rendered ground truth."""
