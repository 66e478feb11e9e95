"""The plate's camera from its pictures: field of view, horizon and path."""
