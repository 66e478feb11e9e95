import pytest

from nlens_video.core.errors import UsageError
from nlens_video.graph.nodes.registry import STAGES
from nlens_video.graph.pipeline_file import load_pipeline, shipped_pipelines

NODE = """
[[node]]
name = "{name}"
stage = "{stage}"
inputs = {inputs}
output = "{output}"
cadence = "{cadence}"
lane = "{lane}"
"""


def node(**changes):
    values = dict(
        name="a", stage="locate", inputs='["frame"]', output="placement", cadence="frame",
        lane="render",
    )  # fmt: skip
    return NODE.format(**{**values, **changes})


@pytest.mark.parametrize("preset", sorted(shipped_pipelines()))
def test_shipped_pipeline_loads_and_names_only_known_stages(preset):
    pipeline = load_pipeline(preset)
    assert pipeline.summary
    assert {spec.stage for spec in pipeline.nodes} <= set(STAGES)
    assert pipeline.nodes[-1].output == "picture"


def test_own_pipeline_file_is_used_by_its_path(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(node())
    assert [spec.name for spec in load_pipeline(str(path)).nodes] == ["a"]


def test_port_that_may_be_missing_need_not_be_written_at_all(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(node(inputs='["frame", "shadow?"]'))
    assert load_pipeline(str(path)).nodes[0].optional == ("shadow",)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no \\[\\[node\\]\\]"),
        ("not toml [", "cannot be read"),
        (node(inputs='["layer"]'), "reads 'layer', which none above writes"),
        (node(inputs='["layer?"]') + node(name="b", output="layer"), "reads 'layer', which none"),
        (node(inputs='["nothing"]'), "no port 'nothing'"),
        (node(cadence="sometimes"), "'cadence' is 'sometimes'"),
        (node(lane="fast"), "'lane' is 'fast'"),
        (node() + "colour = 1", "unknown key 'colour'"),
        (node() + node(), "two nodes are called 'a'"),
        (node(lane="lens") + node(name="b"), "goes back to lane"),
        (node() + 'when = "raining"', "'when' is 'raining'"),
        (node() + 'effect = "glitter"', "'effect' is 'glitter'"),
        ("pipeline = 3\n" + node(), "must be a table"),
        (node(inputs="3"), "'inputs' must be a list"),
    ],
)
def test_wrong_pipeline_file_is_named_in_one_line(tmp_path, text, message):
    path = tmp_path / "wrong.toml"
    path.write_text(text)
    with pytest.raises(UsageError, match=message) as caught:
        load_pipeline(str(path))
    assert str(path) in str(caught.value)


def test_unknown_preset_lists_the_known_ones():
    with pytest.raises(UsageError, match="standard"):
        load_pipeline("cinematic")
