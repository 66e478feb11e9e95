"""The nodes that a pipeline file can name: all subclasses of `Node` in the modules listed here."""

from __future__ import annotations

import inspect

from nlens_video.graph.base.node import Node
from nlens_video.graph.nodes import (
    camera,
    composite,
    distortion,
    find_lens,
    motion_blur,
    object_layer,
    occlusion,
    reblur,
    reflection,
    shadow,
)

FAMILIES = (
    find_lens, object_layer, motion_blur, reblur, shadow, reflection, occlusion, distortion,
    camera, composite,
)  # fmt: skip

NODES: dict[str, type[Node]] = {
    cls.name: cls
    for family in FAMILIES
    for cls in vars(family).values()
    if inspect.isclass(cls) and issubclass(cls, Node) and cls.__module__ == family.__name__
}
"""Name to class."""

FORMER_NAMES = {
    "locate": "object-bounds",
    "project": "ground-footprint",
    "light": "estimate-light",
    "follow": "match-exposure",
    "motion": "measure-motion",
    "moments": "select-samples",
    "expose": "render-motion",
    "smear": "motion-blur",
    "sharp": "crop-sharp",
    "scatter": "reblur",
    "lens": "lens-sampling",
    "views": "aperture-views",
    "lay-views": "blend-views",
    "peel": "depth-peel",
    "past-edges": "edge-parallax",
    "repair": "depth-order",
    "matte": "occlusion-cue",
    "hold-out": "foreground",
    "darken": "composite-shadow",
    "lay-reflection": "composite-reflection",
    "widen": "add-overscan",
    "narrow": "remove-overscan",
    "bend": "distort",
    "bend-shadow": "distort-shadow",
    "bend-reflection": "distort-reflection",
    "fringe": "chromatic-aberration",
}
"""Names of nodes before 1.0, as older pipeline files have them, to today's."""
