"""What every renderer shares: the view of a box, lights, material buffers."""
