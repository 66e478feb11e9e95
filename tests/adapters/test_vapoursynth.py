"""The filter for VapourSynth, on clips of the real core, and in scripts of the real vspipe."""

import os
import re
import subprocess
import sys
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from support import shots
from support.conformance import (
    CASES,
    FRAMES,
    OPTIONS,
    RATE,
    Composited,
    assert_conforms,
    assert_same_errors,
    decoded,
    of_frames,
)
from support.folders import ROOT

from nlens_video.video.info import FrameTags

pytestmark = [pytest.mark.needs_gl, pytest.mark.needs_vapoursynth]


@pytest.fixture(autouse=True)
def source():
    """The module that makes clips of files; it needs VapourSynth."""
    import vapoursynth  # noqa: F401
    from support import vapoursynth_source

    return vapoursynth_source


@pytest.fixture
def adapter(source):
    from nlens_video.vapoursynth import composite

    def run(plate, options):
        options = dict(options)
        clip = composite(source.clip_of(plate.path), options.pop("glb", plate.glb), **options)
        frames = [clip.get_frame(number) for number in range(clip.num_frames)]
        props = frames[0].props
        tags = FrameTags(
            colorspace=props["_Matrix"], color_range=props["_Range"] + 1,
            color_primaries=props["_Primaries"], color_trc=props["_Transfer"],
        )  # fmt: skip
        each = [Fraction(one.props["_DurationNum"], one.props["_DurationDen"]) for one in frames]
        times = [sum(each[:number], Fraction(0)) for number in range(len(each))]
        return Composited([source.planes_by_ffmpeg(frame) for frame in frames], times, tags)

    return run


@pytest.mark.slow
@pytest.mark.parametrize("case", sorted(set(CASES) - {"packed"}))
def test_frames_are_those_of_the_command_line(case, adapter, plates, expected):
    assert_conforms(adapter, plates(case), expected(case))


@pytest.mark.slow
def test_errors_are_those_of_the_command_line(adapter, plates):
    import vapoursynth

    assert_same_errors(adapter, plates("bt709"), vapoursynth.Error)


@pytest.fixture
def clip(source, plates):
    return source.clip_of(plates("bt709").path)


@pytest.fixture
def composited(plates):
    from nlens_video.vapoursynth import composite

    plate = plates("bt709")
    return lambda clip, **options: composite(
        clip, plate.glb, **{**OPTIONS, "fit": plate.fit, **options}
    )


def samples(frame):
    return [np.asarray(frame[number]).copy() for number in range(frame.format.num_planes)]


def assert_same(one, other):
    for mine, theirs in zip(samples(one), samples(other), strict=True):
        np.testing.assert_array_equal(mine, theirs)


@pytest.mark.slow
def test_frames_in_any_order_are_the_same_bits(clip, composited):
    straight = [composited(clip).get_frame(number) for number in range(FRAMES)]
    mixed = composited(clip)
    for number in (5, 2, 0, 4, 2):
        assert_same(mixed.get_frame(number), straight[number])


@pytest.mark.slow
def test_lens_is_that_of_the_first_frames_whichever_is_asked_for_first(clip, composited):
    words = {"fit": None, "fallback": "constant"}
    straight, backwards = composited(clip, **words), composited(clip, **words)
    last = backwards.get_frame(FRAMES - 1)
    assert_same(straight.get_frame(0), backwards.get_frame(0))
    assert_same(straight.get_frame(FRAMES - 1), last)


@pytest.fixture
def asked():
    """A blank clip of 1200 frames, and the numbers of those that were asked for."""
    import vapoursynth as vs

    numbers = []
    blank = vs.core.std.BlankClip(
        format=vs.YUV420P8, width=64, height=36, length=1200, fpsnum=RATE, fpsden=1
    )

    def noted(n, f):
        numbers.append(n)
        return f

    return blank.std.ModifyFrame(clips=blank, selector=noted), numbers


def test_only_the_first_frame_is_composited_beforehand_where_no_effect_needs_the_lens(
    asked, composited
):
    clip, numbers = asked
    composited(clip, fit=None, effects="none")
    assert numbers == [0]


def test_object_that_is_never_in_view_is_looked_for_on_a_thousand_frames_at_most(asked, tmp_path):
    from nlens_video.vapoursynth import composite

    clip, numbers = asked
    shots.cube_glb(tmp_path / "behind.glb", start=(0.0, 0.0, 5.0))
    made = composite(clip, tmp_path / "behind.glb", preset="draft", effects="defocus")
    assert numbers == list(range(1000))
    assert_same(made.get_frame(1100), clip.get_frame(1100))


def test_range_is_read_from_either_property(source):
    from nlens_video.adapters.vapoursynth_clip import _tags

    assert [_tags(props).color_range for props in (
        {}, {"_Range": 0}, {"_Range": 1}, {"_ColorRange": 1}, {"_ColorRange": 0},
    )] == [0, 1, 2, 1, 2]  # fmt: skip


def test_properties_of_other_filters_are_kept(clip, composited):
    marked = clip.std.SetFrameProps(_SceneChangePrev=1, mine="kept")
    props = composited(marked).get_frame(0).props
    assert (props["_SceneChangePrev"], props["mine"], props["_Matrix"]) == (1, "kept", 1)


def test_pixels_that_are_not_square_are_honoured(clip, composited):
    wide = clip.std.SetFrameProps(_SARNum=2, _SARDen=1)
    square, other = (np.asarray(composited(one).get_frame(0)[0]) for one in (clip, wide))
    assert (square != other).any()


def test_clip_of_variable_rate_follows_the_time_of_its_frames(source, clip, composited):
    varying = source.without_rate(clip)
    with pytest.raises(Exception, match=r"no _AbsoluteTime; use a source that sets it"):
        composited(varying)
    timed = source.timed(varying, [0.0, 0.2, 0.04, 0.08, 0.12, 0.16])
    one, other = composited(timed, effects="none"), composited(clip, effects="none")
    assert_same_object(one.get_frame(1), other.get_frame(5), clip, (1, 5))


def assert_same_object(one, other, clip, numbers):
    """Where the plate's noise differs, the object covers the same pixels."""
    covers = []
    for frame, number in zip((one, other), numbers, strict=True):
        plain = np.asarray(clip.get_frame(number)[0])
        covers.append(np.asarray(frame[0]) != plain)
    assert covers[0].any() and (covers[0] != covers[1]).mean() < 0.2 * covers[0].mean()


@pytest.mark.parametrize("name", ["YUV444PS", "RGBH", "YUV444PH"])
def test_formats_that_cannot_be_composited_in_are_refused(name, composited):
    import vapoursynth as vs

    blank = vs.core.std.BlankClip(format=getattr(vs, name), width=64, height=32, length=2)
    with pytest.raises(vs.Error, match=f"a clip of {name}; expected integer YUV"):
        composited(blank)


def test_grey_clips_and_floats_are_composited_in(composited, clip):
    import vapoursynth as vs

    for name in ("GRAY8", "GRAY16", "RGBS"):
        plain = clip.resize.Bicubic(format=getattr(vs, name), matrix_in_s="709")
        made = composited(plain).get_frame(0)
        assert made.format.id == plain.format.id
        assert (np.asarray(made[0]) != np.asarray(plain.get_frame(0)[0])).any()


@pytest.mark.slow
@pytest.mark.parametrize(
    "kept", ["clip = clip", "clip.set_output()", "clip = [clip]; clip += [clip]"]
)
def test_clip_that_lives_until_python_ends_leaves_no_word(kept, plates):
    folder = plates("bt709").folder
    script = (
        "import tempfile\n"
        "folder = tempfile.TemporaryDirectory()  # begun before VapourSynth, ends after it\n"
        "import vapoursynth as vs\n"
        "from nlens_video.vapoursynth import composite\n"
        "clip = vs.core.std.BlankClip(width=64, height=48, format=vs.YUV420P8, length=2)\n"
        "clip = composite(clip, 'anim.glb', preset='draft', fit='fit.json')\n"
        f"{kept}\n"
    )
    run = subprocess.run(
        [sys.executable, "-c", script], cwd=folder, capture_output=True, text=True, check=False,
        env={**os.environ, "PYTHONPATH": str(ROOT)}, timeout=120,
    )  # fmt: skip
    assert (run.returncode, run.stdout, run.stderr) == (0, "", "")


@pytest.fixture
def vspipe(plates, tmp_path):
    """Runs the line of the page on its script, whose source filter is the tests' own."""
    page = (ROOT / "docs" / "vapoursynth.md").read_text()
    (script,) = re.findall(r"^```python\n(.*?)^```", page, re.M | re.S)
    (line,) = (one for one in page.splitlines() if one.startswith("vspipe "))
    source = "vs.core.bs.VideoSource("
    assert source in script
    own = "from support.vapoursynth_source import clip_of\n"
    script = own + script.replace(source, "clip_of(")
    environment = {
        **os.environ, "PYTHONPATH": f"{ROOT}:{ROOT / 'tests'}", "XDG_CONFIG_HOME": str(tmp_path),
        "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}",
    }  # fmt: skip
    folder = plates("bt709").folder

    def run(changed=("", "")):
        (folder / "shot.vpy").write_text(script.replace(*changed))
        return subprocess.run(
            ["bash", "-o", "pipefail", "-c", f"vapoursynth config > config.txt && {line}"],
            cwd=folder, capture_output=True, text=True, check=False, env=environment, timeout=120,
        )  # fmt: skip

    return run


@pytest.mark.slow
@pytest.mark.needs_programs("ffmpeg")
def test_documented_line_writes_the_frames_of_the_command_line(vspipe, plates, expected):
    words = 'preset="realtime"'
    run = vspipe((words, f'{words}, fit="fit.json"'))
    assert run.returncode == 0, run.stderr
    made = of_frames(decoded(plates("bt709").folder / "out.mkv"))
    assert made.times == expected("bt709").times
    for one, other in zip(made.planes, expected("bt709").planes, strict=True):
        assert all(map(np.array_equal, one, other))


@pytest.mark.slow
def test_vspipe_tells_an_error_by_its_line(vspipe):
    run = vspipe(("anim.glb", "none.glb"))
    assert run.returncode != 0 and "none.glb: cannot be read" in run.stderr
