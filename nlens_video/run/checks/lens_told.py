"""Whether any picture was more than one colour, where the lens is read off the plate."""

from __future__ import annotations

from nlens_video.core.errors import LensFitError
from nlens_video.graph.nodes.object_and_lens import EstimateCoc, FitNode
from nlens_video.graph.session import Session


def check_lens_told(session: Session, *, live: bool = False) -> None:
    """Check a session whose last frame has come.

    Args:
        session: the session.
        live: whether its frames come only once, and are kept without the object; a note tells it.

    Raises:
        LensFitError: its lens was to be read off the plate, and only black pictures, or others of
            one colour, have come, or none that tells it.
    """
    for node in session.nodes:
        if isinstance(node, FitNode) and node.search.failure is not None:
            raise node.search.failure
        if isinstance(node, EstimateCoc) and node.notes and not live:
            raise LensFitError(node.notes[0])
