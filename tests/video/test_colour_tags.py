"""Plates whose colour tags say what is supported, what is not, and nothing."""

import av
import pytest
from support import shots
from support.clips import noise_frame, write_clip

from nlens_video.cli.main import main
from nlens_video.core.errors import InputError
from nlens_video.video.input.source import open_source

TAGS = {"colorspace": 9, "color_primaries": 9, "color_trc": 16, "color_range": 1}


def plate(path, **tags):
    """A video of FFV1 with FFmpeg's numbers of its colour."""
    frames = [noise_frame(32, 24, "yuv420p10le", seed) for seed in range(2)]
    for frame in frames:
        for name, number in (TAGS | tags).items():
            setattr(frame, name, number)
    return write_clip(path, frames)


def meaning(path, **hints):
    with open_source(str(path), **hints) as source:
        return source.info.tags


@pytest.mark.parametrize(
    ("tags", "named", "remedy"),
    [
        ({"colorspace": 14}, "matrix ictcp", "zscale=matrix="),
        ({"colorspace": 10}, "matrix bt2020c", "zscale=matrix="),
        ({"colorspace": 8}, "matrix ycgco", "zscale=matrix="),
        ({"color_trc": 9}, "transfer log100", "--input-transfer"),
        ({"color_trc": 10}, "transfer log316", "--input-transfer"),
        ({"color_trc": 17}, "transfer smpte428", "--input-transfer"),
        ({"color_primaries": 10}, "primaries smpte428", "zscale=primaries=bt2020"),
    ],
)
def test_a_tag_that_is_not_supported_is_refused_by_its_name_with_what_to_do(
    tmp_path, tags, named, remedy
):
    path = plate(tmp_path / "in.mkv", **tags)
    with pytest.raises(InputError) as caught:
        meaning(path)
    assert named in str(caught.value) and remedy in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_command_line_refuses_such_a_plate_before_it_writes(tmp_path, capsys):
    shots.cube_glb(tmp_path / "anim.glb")
    path, out = plate(tmp_path / "in.mkv", colorspace=14), tmp_path / "out.mkv"
    assert main([str(path), str(tmp_path / "anim.glb"), str(out)]) == 3
    err = capsys.readouterr().err
    assert "matrix ictcp" in err and err.count("\n") == 1, err
    assert not out.exists()


def test_a_given_transfer_function_replaces_one_that_is_not_supported(tmp_path):
    tags = meaning(plate(tmp_path / "in.mkv", color_trc=10), input_transfer="smpte2084")
    assert (tags.transfer, tags.assumed) == ("smpte2084", ())


@pytest.mark.parametrize("number", [0, 2, 3])
def test_a_tag_that_says_nothing_is_assumed(tmp_path, number):
    path = plate(tmp_path / "in.mkv", colorspace=number, color_trc=number, color_primaries=number)
    assert meaning(path).assumed == ("matrix=smpte170m", "transfer=bt709", "primaries=bt709")


@pytest.mark.parametrize(("number", "alike"), [(11, "bt709"), (12, "bt709")])
def test_xvycc_and_bt1361_have_the_curve_of_bt709(tmp_path, number, alike):
    tags = meaning(plate(tmp_path / "in.mkv", color_trc=number))
    assert (tags.transfer, tags.assumed) == (alike, ())


@pytest.mark.parametrize(("number", "name"), [(8, "film"), (22, "ebu3213")])
def test_primaries_of_film_and_ebu3213_are_known(tmp_path, number, name):
    tags = meaning(plate(tmp_path / "in.mkv", color_primaries=number))
    assert (tags.primaries, tags.assumed) == (name, ())


@pytest.mark.needs_gl
def test_what_a_given_transfer_function_replaces_stays_in_the_result(tmp_path):
    shots.write_video(tmp_path / "plain.mkv", codec="ffv1", pix_fmt="yuv420p", frames=2)
    with av.open(str(tmp_path / "plain.mkv")) as before:
        frames = list(before.decode(video=0))
    for frame in frames:
        frame.color_trc = 10
    write_clip(tmp_path / "in.mkv", frames)
    shots.cube_glb(tmp_path / "anim.glb")
    shots.fit_json(tmp_path / "fit.json")
    words = ("in.mkv", "anim.glb", "out.mkv", "--fit", "fit.json")
    more = ["-q", "--effects", "defocus", "--preset", "draft", "--input-transfer", "srgb"]
    assert main([str(tmp_path / word) if "." in word else word for word in words] + more) == 0
    with av.open(str(tmp_path / "out.mkv")) as made:
        assert {frame.color_trc for frame in made.decode(video=0)} == {10}


def test_vp9_with_alpha_keeps_the_tags_of_its_container(tmp_path):
    frames = [noise_frame(64, 48, "yuva420p", seed) for seed in range(3)]
    for frame in frames:
        for name, number in (TAGS | {"color_trc": 14}).items():
            setattr(frame, name, number)
    path = write_clip(tmp_path / "in.webm", frames, codec="libvpx-vp9", alpha=True)
    with open_source(str(path)) as source:
        tags = source.info.frame_tags
        assert source.info.pixel_format == "yuva420p"
    assert (tags.colorspace, tags.color_primaries, tags.color_trc) == (9, 9, 14)
