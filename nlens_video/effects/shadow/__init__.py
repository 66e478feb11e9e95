"""The object's shadow on the ground: cast, blurred and composited."""
