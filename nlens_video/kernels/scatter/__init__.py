"""The layered scatter: premultiplied pixels spread over the discs of their CoC."""
