"""Heavy libraries, one file each."""
