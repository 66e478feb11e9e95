"""The glTF 2.0 reader: accessors, materials, meshes, animations, lights, compressed data."""
