"""Effects of the plate's camera beside defocus: measured on the plate, applied to the object."""
