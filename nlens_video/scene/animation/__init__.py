"""Animation: keyframe tracks and their evaluation."""
