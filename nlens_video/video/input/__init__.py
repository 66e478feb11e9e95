"""Sources: files, streams, devices and sequences, decoded frame by frame."""
