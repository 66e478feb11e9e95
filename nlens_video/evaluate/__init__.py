"""The paper's protocol and beyond: stages measured against rendered ground truth."""
