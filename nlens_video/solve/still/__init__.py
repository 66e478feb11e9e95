"""The camera of one picture: line segments, vanishing points and the ground's blur."""
