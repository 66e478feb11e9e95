"""What a camera does to a picture, and which of it a scene calls for."""
