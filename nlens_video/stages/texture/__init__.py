"""The lens by the ground's texture: one spectrum, seen at all depths; an addition to the paper."""
