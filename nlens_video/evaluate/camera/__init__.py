"""Accuracy of the solved camera against plates and clips whose camera is known."""
