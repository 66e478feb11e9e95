"""What moves in front of the object: background of the shot, things before it, their mattes."""
