"""Video in and out through FFmpeg (PyAV), stills, sequences, pipes and OpenEXR layers."""
