"""The compositor as a streaming class for OpenCV, PyAV and numpy loops."""
