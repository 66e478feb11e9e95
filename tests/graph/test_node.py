"""Nodes: ports derived from signatures, alternatives, operations and conditions."""

from typing import TYPE_CHECKING

import pytest

from nlens_video.core.layers import Box
from nlens_video.graph.base.node import Condition, Node, port_type, ports_of
from nlens_video.graph.base.values import FrameValues
from nlens_video.graph.node_registry import NODES

if TYPE_CHECKING:
    from nlens_video.core.layers import BlurredLayer, DefocusedLayer, ObjectLayer, Picture
    from nlens_video.core.lens_fit import LensFit


def values(**ports):
    given = {"frame": None, "picture": "plate", "frame_box": Box(0, 0, 4, 4)}
    return FrameValues(**{**given, **ports})


class FromLayer(Node):
    name, writes = "from-layer", "blurred"

    def __call__(self, layer: "ObjectLayer") -> "BlurredLayer":
        return "from the layer"


class FromDefocused(Node):
    name, writes = "from-defocused", "blurred"

    def __call__(self, defocused: "DefocusedLayer") -> "BlurredLayer":
        return "from the defocused layer"


class Operation(Node):
    name, writes = "operation", "blurred"

    def __call__(self, blurred: "BlurredLayer", fit: "LensFit | None") -> "BlurredLayer":
        return f"{blurred}, changed"


def run(nodes, frame):
    for node in nodes:
        if node.runs_on(frame):
            setattr(frame, node.writes, node.run(*node.arguments(frame)))
    return frame.blurred


def test_node_ports_are_derived_from_the_signature():
    assert [(port.name, port.type, port.optional) for port in Operation.inputs()] == [
        ("blurred", "BlurredLayer", False),
        ("fit", "LensFit", True),
    ]


def test_node_class_with_a_wrong_port_type_is_refused():
    with pytest.raises(TypeError, match="port 'layer' is a ObjectLayer, not a Picture"):

        class Wrong(Node):
            name, writes = "wrong", "blurred"

            def __call__(self, layer: "Picture") -> "BlurredLayer":
                return layer


def test_node_class_with_an_unknown_port_is_refused():
    with pytest.raises(TypeError, match="'sparkle' is not a port"):

        class Wrong(Node):
            name, writes = "wrong", "blurred"

            def __call__(self, sparkle: "Picture") -> "BlurredLayer":
                return sparkle


def test_node_class_that_is_the_same_with_no_input_of_its_own_is_refused():
    with pytest.raises(TypeError, match=r"same_with names \['fit'\], no inputs of it"):

        class Wrong(Node):
            name, writes = "wrong", "blurred"
            same_with = ("layer", "fit")

            def __call__(self, layer: "ObjectLayer") -> "BlurredLayer":
                return "from the layer"


def test_node_class_with_a_wrong_result_type_is_refused():
    with pytest.raises(TypeError, match="returns Picture, but its port 'blurred' is a Blurred"):

        class Wrong(Node):
            name, writes = "wrong", "blurred"

            def __call__(self, picture: "Picture") -> "Picture":
                return picture


def test_node_class_without_a_call_method_is_refused():
    with pytest.raises(TypeError, match="defines no __call__"):

        class Wrong(Node):
            name, writes = "wrong", "blurred"


def test_condition_on_an_unknown_port_is_refused():
    with pytest.raises(TypeError, match="'sparkle' is not a port"):
        Condition("bright", "the frame sparkles", lambda sparkle: True)


def test_condition_is_false_on_a_frame_without_its_port():
    def wide(frame_box: "Box", layer: "ObjectLayer") -> bool:
        return frame_box.width > 3

    condition = Condition("wide", "the frame is wide", wide)
    assert condition.met(values(layer="layer")) and not condition.met(values())


@pytest.mark.parametrize(
    ("ports", "expected"),
    [
        ({"layer": 1}, "from the layer"),
        ({"defocused": 1}, "from the defocused layer"),
        ({"layer": 1, "defocused": 1}, "from the defocused layer"),
        ({}, None),
    ],
)
def test_first_runnable_alternative_writes_the_port(ports, expected):
    assert run([FromDefocused(None), FromLayer(None)], values(**ports)) == expected


def test_operations_on_a_port_form_a_chain():
    chain = [FromLayer(None), Operation(None), Operation(None)]
    assert run(chain, values(layer=1)) == "from the layer, changed, changed"
    assert run([Operation(None)], values()) is None


def test_every_node_annotates_its_ports_with_their_types():
    for node in NODES.values():
        assert all(port.type == port_type(port.name) for port in node.inputs()), node
        assert node.when is None or ports_of(node.when.test), node


def test_stateful_nodes_read_only_the_picture():
    for node in NODES.values():
        if node.stateful:
            assert [port.name for port in node.inputs()] == ["picture"], node
