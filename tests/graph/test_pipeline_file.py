"""Pipeline files: the current format, the format before 1.0, and errors in one line."""

import inspect

import pytest

from nlens_video.core.errors import UsageError
from nlens_video.graph.node_registry import NODES
from nlens_video.graph.pipeline_file import FORMER_NAMES, load_pipeline, shipped_pipelines

FORMER_NODE = """
[[node]]
name = "{name}"
stage = "{stage}"
inputs = {inputs}
output = "{output}"
cadence = "frame"
lane = "render"
"""


def write(tmp_path, nodes, **keys):
    path = tmp_path / "mine.toml"
    head = "".join(f"{key} = {value}\n" for key, value in keys.items())
    path.write_text(f"{head}nodes = {nodes}\n")
    return str(path)


def former(name, stage=None, inputs='["frame"]', output="placement", more=""):
    table = FORMER_NODE.format(name=name, stage=stage or name, inputs=inputs, output=output)
    return table + more


@pytest.mark.parametrize("preset", sorted(shipped_pipelines()))
def test_shipped_pipelines_load_without_notes_and_write_the_picture_last(preset):
    pipeline = load_pipeline(preset)
    assert pipeline.summary and not pipeline.notes
    assert pipeline.nodes[-1].type.writes == "picture"


@pytest.mark.parametrize("preset", sorted(shipped_pipelines()))
def test_the_plates_camera_does_to_the_mirror_image_what_it_does_to_the_object(preset):
    names = [spec.name for spec in load_pipeline(preset).nodes]
    of_camera = [spec.name for spec in load_pipeline("standard").nodes]
    of_camera = of_camera[of_camera.index("vignette") : of_camera.index("composite")]
    wanted = [name for name in names if name in of_camera and name != "edge-parallax"]
    done = names[names.index("blur-reflection") + 1 : names.index("composite-reflection")]
    assert done == [f"{name}-reflection" for name in wanted]


def test_pipeline_file_is_loaded_by_its_path(tmp_path):
    path = write(tmp_path, '["object-bounds", "render"]', summary='"mine"')
    pipeline = load_pipeline(path)
    assert (pipeline.name, pipeline.summary) == ("mine", "mine")
    assert [spec.name for spec in pipeline.nodes] == ["object-bounds", "render"]


def test_node_options_are_read_from_the_pipeline_file(tmp_path):
    path = write(tmp_path, '["object-bounds", { node = "measure-motion", most_moments = 5 }]')
    assert load_pipeline(path).nodes[1].options == {"most_moments": 5}


def test_integer_is_accepted_for_a_float_option(tmp_path):
    nodes = '["object-bounds", "estimate-coc", "ground-footprint", '
    path = write(tmp_path, nodes + '{ node = "fit", anchor_weight = 1 }]')
    assert load_pipeline(path).nodes[-1].options == {"anchor_weight": 1}


def test_optional_input_needs_no_writer(tmp_path):
    path = write(tmp_path, '["object-bounds", "render", "crop-sharp", "composite"]')
    assert [port.name for port in load_pipeline(path).nodes[-1].type.inputs() if port.optional]


@pytest.mark.parametrize(
    ("nodes", "message"),
    [
        ("[]", "no list 'nodes'"),
        ("3", "no list 'nodes'"),
        ('["sparkle"]', "no node 'sparkle'"),
        ("[7]", "7 in 'nodes' is neither"),
        ('["render"]', "'render' reads 'bounds', which none above it writes"),
        ('["object-bounds", "object-bounds"]', "'object-bounds' stands twice"),
        ('[{ node = "object-bounds", radius = 3 }]', "has no option 'radius'"),
        (
            '["object-bounds", { node = "measure-motion", most_moments = "many" }]',
            "'most_moments' of node 'measure-motion' is 'many', expected int",
        ),
        (
            '["object-bounds", { node = "fit", whole_plane = 1 }]',
            "'whole_plane' of node 'fit' is 1, expected bool",
        ),
        *(
            (
                f'["object-bounds", {{ node = "{node}", {option} = {value} }}]',
                f"'{option}' of node '{node}' is {value}, expected {expected}",
            )
            for node, option, value, expected in (
                ("shadow", "lamp_points", "-3", "1 to 4096"),
                ("shadow", "ambient_directions", "0", "1 to 4096"),
                ("measure-motion", "most_moments", "0", "1 to 257"),
                ("reflect", "most_moments", "5000000", "1 to 257"),
                ("fit", "anchor_weight", "-1.0", "0 to 1"),
                ("fit", "anchor_weight", "nan", "0 to 1"),
                ("lens-sampling", "accuracy_db", "inf", "10 to 100"),
                ("reblur", "detail", "'x'", "'fine' or 'draft'"),
            )
        ),
        ('[{ node = "render", fallback_for = "sparkle" }]', "'sparkle', which is no node"),
        (
            '["object-bounds", { node = "render", fallback_for = "lens-sampling" }]',
            "does not stand above",
        ),
        (
            '["object-bounds", "render", "crop-sharp", "exposure"]',
            "'exposure' runs on lane 'render', but stands below",
        ),
        (
            '["object-bounds", "render", "composite", "crop-sharp"]',
            "'composite' reads 'blurred', which none above it writes",
        ),
    ],
)
def test_invalid_pipeline_file_is_refused_in_one_line_with_its_path(tmp_path, nodes, message):
    path = write(tmp_path, nodes)
    with pytest.raises(UsageError) as caught:
        load_pipeline(path)
    assert message in str(caught.value) and str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("not toml [", "cannot be read"),
        ("colour = 1\nnodes = []", "unknown key 'colour'"),
        ('summary = 5\nnodes = ["object-bounds"]', "'summary' is 5, expected a text"),
    ],
)
def test_file_that_is_not_a_pipeline_is_refused(tmp_path, text, message):
    path = tmp_path / "wrong.toml"
    path.write_text(text)
    with pytest.raises(UsageError, match=message):
        load_pipeline(str(path))


def test_unknown_preset_error_lists_the_known_ones():
    with pytest.raises(UsageError, match="standard"):
        load_pipeline("cinematic")


def test_file_format_before_1_0_is_read_with_a_note(tmp_path):
    path = tmp_path / "old.toml"
    path.write_text(
        '[pipeline]\nsummary = "old"\n'
        + former("locate")
        + former("motion", inputs='["placement", "fit?"]', output="motion",
                 more="options = { most_moments = 3 }\n")
        + former("render", inputs='["placement", "fit?"]', output="layer")
        + former("sharp", inputs='["layer", "frame_box"]', output="blurred")
        + former("smear", inputs='["motion", "frame_box", "blurred?"]', output="blurred")
        + former("composite", inputs='["picture", "blurred"]', output="picture")
    )  # fmt: skip
    pipeline = load_pipeline(str(path))
    assert [spec.name for spec in pipeline.nodes] == [
        "object-bounds", "measure-motion", "render", "crop-sharp", "motion-blur", "composite",
    ]  # fmt: skip
    assert pipeline.nodes[1].options == {"most_moments": 3} and pipeline.summary == "old"
    assert "form before 1.0" in pipeline.notes[0]


def test_file_format_before_1_0_gets_the_sharp_layer_after_its_alternative(tmp_path):
    path = tmp_path / "old.toml"
    find = [
        former("estimate-coc", output="plate_coc"),
        former("project", output="ground"),
        former("fit", output="fit"),
    ]
    path.write_text(
        former("locate") + "".join(find) + former("render", output="layer")
        + former("object-coc", output="defocused") + former("sharp", output="blurred")
        + former("reblur", "scatter", output="blurred") + former("repair", output="blurred")
    )  # fmt: skip
    names = [spec.name for spec in load_pipeline(str(path)).nodes]
    assert names[-3:] == ["reblur", "crop-sharp", "depth-order"]


def test_file_format_before_1_0_gets_the_blur_of_shadow_and_reflection_before_their_composite(
    tmp_path,
):
    path = tmp_path / "old.toml"
    path.write_text(
        former("locate") + former("shadow", output="shadow") + former("reflect")
        + former("darken", output="picture") + former("lay-reflection", output="picture")
    )  # fmt: skip
    names = [spec.name for spec in load_pipeline(str(path)).nodes]
    assert names == [
        "object-bounds", "shadow-casters", "reflect", "shadow",
        "blur-shadow", "composite-shadow", "blur-reflection", "composite-reflection",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("table", "message"),
    [
        (former("a", "sparkle"), "no stage 'sparkle'"),
        (former("locate", more="options = 3\n"), "'options' must be a table"),
        ("pipeline = 3\n" + former("locate"), "must be"),
    ],
)
def test_invalid_file_in_the_format_before_1_0_is_refused(tmp_path, table, message):
    path = tmp_path / "old.toml"
    path.write_text(table)
    with pytest.raises(UsageError, match=message):
        load_pipeline(str(path))


def test_former_node_names_map_to_existing_nodes():
    assert set(FORMER_NAMES.values()) <= set(NODES)
    assert not set(FORMER_NAMES) & set(NODES)


def test_defaults_of_options_lie_in_their_ranges():
    for node in NODES.values():
        defaults = inspect.signature(node.__init__).parameters
        for name, least, most in node.ranges:
            assert least <= defaults[name].default <= most, (node.name, name)
