"""A node: a plain callable with named, typed ports, a cadence and a condition."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal, get_args

from nlens_video.core.layers import Box, DefocusedLayer
from nlens_video.core.lens_fit import LensFit
from nlens_video.graph.nodes.object_source import Placement
from nlens_video.stages.l_reblur import NEGLIGIBLE_COC_PX

Cadence = Literal["shot", "frame"]
LaneName = Literal["render", "lens"]
CADENCES: tuple[Cadence, ...] = get_args(Cadence)
LANES: tuple[LaneName, ...] = get_args(LaneName)

PORTS: dict[str, str] = {
    "frame": "SourceFrame",
    "picture": "Picture",
    "frame_box": "Box",
    "following": "tuple[Picture, ...]",
    "placement": "Placement",
    "illumination": "Illumination",
    "plate_coc": "CocMap",
    "ground": "GroundProjection",
    "fit": "LensFit",
    "layer": "ObjectLayer",
    "defocused": "DefocusedLayer",
    "views": "FewViews",
    "blurred": "BlurredLayer",
    "shadow": "Shadow",
    "motion": "Motion",
    "moments": "Motion",
    "exposed": "BlurredLayer",
    "reflection": "DefocusedLayer",
    "front": "Front",
    "foreground": "Foreground",
    "exposure": "Exposure",
}
STEP_PX = 2.0  # between neighbours: less than that, parts of the object do not hide others visibly
GIVEN = ("frame", "picture", "frame_box", "following")

Values = dict[str, object]


def _out_of_focus(values: Mapping[str, object]) -> bool:
    defocused = values.get("defocused")
    return isinstance(defocused, DefocusedLayer) and (defocused.largest_coc_px >= NEGLIGIBLE_COC_PX)


def _in_frame(values: Mapping[str, object]) -> bool:
    placement, frame = values.get("placement"), values.get("frame_box")
    return (
        isinstance(placement, Placement)
        and isinstance(frame, Box)
        and not placement.box.intersection(frame).empty
    )


def _depth_steps(values: Mapping[str, object]) -> bool:
    defocused = values.get("defocused")
    if not isinstance(defocused, DefocusedLayer):
        return False
    hides = defocused.behind is not None and not defocused.behind.box.empty
    return hides or defocused.largest_step_px >= STEP_PX


def _depth_range(values: Mapping[str, object]) -> bool:
    placement, fit = values.get("placement"), values.get("fit")
    if not isinstance(placement, Placement) or not isinstance(fit, LensFit):
        return False
    return fit.slope * (1.0 / placement.nearest - 1.0 / placement.farthest) >= STEP_PX


CONDITIONS: dict[str, tuple[Callable[[Mapping[str, object]], bool], str]] = {
    "in-frame": (_in_frame, "the object lies on the frame"),
    "depth-steps": (_depth_steps, f"the CoC steps by {STEP_PX} px inside the object"),
    "depth-range": (_depth_range, f"the object's CoC spans {STEP_PX} px"),
    "out-of-focus": (_out_of_focus, f"the object's CoC reaches {NEGLIGIBLE_COC_PX} px"),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Node:
    """One step of the graph.

    Attributes:
        name: unique in its pipeline; the name in timings.
        stage: what it does, a name of the registry.
        inputs: ports it reads; all must hold a value, or it does not run.
        optional: ports it reads if they hold a value.
        output: port it writes.
        cadence: once a shot, or each frame.
        lane: the thread it runs on.
        effect: the effect it belongs to, or none.
        when: name of the condition that a frame must meet, or none.
        without: port that a frame must not hold, or none.
        backend: what runs it and why, in words.
        run: the stage, called with the inputs and then the optional ports, in order.
        remembers: whether it must see every frame of the source, those before a range included.
    """

    name: str
    stage: str
    inputs: tuple[str, ...]
    optional: tuple[str, ...]
    output: str
    cadence: Cadence
    lane: LaneName
    effect: str | None
    when: str | None
    without: str | None
    backend: str
    run: Callable[..., object]
    remembers: bool = False

    def called_for(self, values: Mapping[str, object]) -> bool:
        """Whether this frame needs the node."""
        if any(values.get(port) is None for port in self.inputs):
            return False
        if self.without is not None and values.get(self.without) is not None:
            return False
        return self.when is None or CONDITIONS[self.when][0](values)

    def arguments(self, values: Mapping[str, object]) -> list[object]:
        """What `run` is called with."""
        return [values.get(port) for port in (*self.inputs, *self.optional)]
