"""An OpenGL context that a driver takes away in mid-run: no picture is lost, none is half drawn.

The losses are real: the context is destroyed, or the display is shut down, under the renderer.
"""

import os
import subprocess
import sys
from pathlib import Path

import av
import numpy as np
import pytest
from support import shots
from support.glb_builder import GlbBuilder
from support.quads import camera_at, quad, unlit

from nlens_video.render.base.drawer import DrawerLostError
from nlens_video.render.opengl.object_renderer import PyrenderObjectRenderer
from nlens_video.render.software.renderer import SoftwareObjectRenderer
from nlens_video.scene import Scene

pytestmark = pytest.mark.needs_gl
TIMES = (0.0, 0.25, 0.5, 0.75, 1.0)


@pytest.fixture
def scene(tmp_path):
    """A card that moves before another one, which it hides in part."""
    builder = GlbBuilder()
    front = quad(builder, number=unlit(builder, (0.9, 0.2, 0.1, 1)), node={"scale": [0.5, 0.5, 1]})
    quad(builder, number=unlit(builder, (0.1, 0.4, 0.9, 1)), node={"translation": [0.3, 0.1, -2]})
    places = np.array([[-0.4, 0, 0], [0.4, 0.1, 0]], np.float32)
    builder.animation((front, "translation", [0.0, 1.0], places, "LINEAR"))
    return Scene.load(builder.write(tmp_path / "scene.glb"))


def destroy(renderer):
    """What a driver does that takes a context away."""
    from OpenGL import EGL

    platform = renderer._drawer._platform
    platform.make_uncurrent()
    EGL.eglDestroyContext(platform._egl_display, platform._egl_context)


def pictures(renderer, lose_before=()):
    """Front and back of each moment; the context goes before some of both kinds of pictures."""
    found = []
    for number, time_s in enumerate(TIMES):
        if ("front", number) in lose_before:
            destroy(renderer)
        layer = renderer.render(time_s, camera_at(4.0))
        if ("behind", number) in lose_before:
            destroy(renderer)
        behind = renderer.render_behind(layer, layer.box, 0.01)
        found.append((layer.rgba, layer.depth, behind.hidden.rgba, behind.front_rgba))
    return found


def assert_same(ones, others):
    for one, other in zip(ones, others, strict=True):
        for mine, its in zip(one, other, strict=True):
            np.testing.assert_array_equal(mine, its)


@pytest.mark.parametrize("kind", ["front", "behind"])
def test_lost_opengl_context_is_replaced_without_a_difference(scene, kind):
    with PyrenderObjectRenderer(scene) as renderer:
        undisturbed = pictures(renderer)
        assert renderer.notes == []
    with PyrenderObjectRenderer(scene) as renderer:
        assert_same(pictures(renderer, {(kind, 2)}), undisturbed)
        (note,) = renderer.notes
    assert note.startswith("at 0.50 s OpenGL was lost (EGLError: EGL_BAD_CONTEXT)")
    assert note.endswith("; a new context draws on from that picture")


@pytest.mark.parametrize("kind", ["front", "behind"])
def test_opengl_context_lost_twice_falls_back_to_the_rasteriser(scene, kind):
    with PyrenderObjectRenderer(scene) as renderer:
        by_opengl = pictures(renderer)
    with SoftwareObjectRenderer(scene) as renderer:
        by_software = pictures(renderer)
    with PyrenderObjectRenderer(scene) as renderer:
        drawn = pictures(renderer, {("front", 1), (kind, 3)})
        assert len(renderer.notes) == 2
        assert "at 0.75 s" in renderer.notes[1]
        assert "the software rasteriser draws on" in renderer.notes[1]
    assert_same(drawn[:3], by_opengl[:3])
    assert_same(drawn[4:], by_software[4:])
    if kind == "front":
        assert_same(drawn[3:4], by_software[3:4])
    else:
        assert_same([drawn[3][:2]], [by_opengl[3][:2]])


def test_pixels_read_after_a_context_loss_are_discarded(scene, monkeypatch):
    from nlens_video.render.opengl.gpu_objects import FloatTarget

    with PyrenderObjectRenderer(scene) as renderer:
        undisturbed = pictures(renderer)
    read, calls = FloatTarget.read, []
    with PyrenderObjectRenderer(scene) as renderer:

        def too_late(target, width, height):
            calls.append(None)
            if len(calls) == 7:  # a picture, and two from behind, each time
                destroy(renderer)
            return read(target, width, height)

        monkeypatch.setattr(FloatTarget, "read", too_late)
        assert_same(pictures(renderer), undisturbed)
        (note,) = renderer.notes
    assert "OpenGL was lost (the context is no longer current)" in note


def test_context_loss_after_the_last_picture_is_ignored(scene):
    with PyrenderObjectRenderer(scene) as renderer:
        pictures(renderer)
        destroy(renderer)
    with PyrenderObjectRenderer(scene) as renderer:
        assert len(pictures(renderer)) == len(TIMES)


def test_rasteriser_is_used_if_no_new_context_can_be_created(scene, monkeypatch):
    with SoftwareObjectRenderer(scene) as renderer:
        by_software = pictures(renderer)
    with PyrenderObjectRenderer(scene) as renderer:
        renderer.render(0.0, camera_at(4.0))
        destroy(renderer)
        monkeypatch.setenv("EGL_DEVICE_ID", "99")
        assert_same(pictures(renderer)[1:], by_software[1:])
        (note,) = renderer.notes
    assert "the software rasteriser draws on" in note


def test_gpu_out_of_memory_falls_back_to_the_rasteriser(scene, monkeypatch):
    """The error is the driver's own kind, raised at the seam: no memory runs out here."""
    from OpenGL import GL
    from OpenGL.error import GLError

    from nlens_video.render.opengl.renderer import LinearRenderer

    def refuse(*given, **named):
        raise GLError(err=GL.GL_OUT_OF_MEMORY)

    with SoftwareObjectRenderer(scene) as renderer:
        by_software = pictures(renderer)
    monkeypatch.setattr(LinearRenderer, "draw", refuse)
    with PyrenderObjectRenderer(scene) as renderer:
        assert_same(pictures(renderer), by_software)
        (note,) = renderer.notes
    assert "OpenGL was lost (its memory does not suffice); the software rasteriser" in note


def test_device_reset_counts_as_a_context_loss(scene, monkeypatch):
    """The status is the seam: no driver here can be reset."""
    from OpenGL import GL

    from nlens_video.render.opengl.egl_platform import open_platform

    platform = open_platform()
    try:
        with platform.at_work("cannot draw", "stop"):
            assert GL.glGetIntegerv(GL.GL_RESET_NOTIFICATION_STRATEGY) in (
                GL.GL_LOSE_CONTEXT_ON_RESET, GL.GL_NO_RESET_NOTIFICATION
            )  # fmt: skip
        monkeypatch.setattr(GL, "glGetGraphicsResetStatus", lambda: GL.GL_INNOCENT_CONTEXT_RESET)
        with pytest.raises(DrawerLostError, match="GL_INNOCENT_CONTEXT_RESET") as lost:
            with platform.at_work("cannot draw", "stop"):
                pass
        assert lost.value.again
    finally:
        platform.delete_context()


LOSING = """
import sys
from OpenGL import EGL
from nlens_video.render.opengl.egl_platform import GlDrawer
from nlens_video.cli.main import main

losses, calls, draw = set(map(int, sys.argv[1].split(","))), [], GlDrawer.draw

def losing(drawer, view):
    calls.append(None)
    if len(calls) in losses:
        drawer._platform.make_uncurrent()
        EGL.eglTerminate(drawer._platform._egl_display)
    return draw(drawer, view)

GlDrawer.draw = losing
sys.exit(main(sys.argv[2:]))
"""


@pytest.fixture(scope="module")
def shot(tmp_path_factory):
    slide = {"start": (-0.2, 0, -1.6), "end": (0.3, 0, -1.5)}
    return shots.write_shot(tmp_path_factory.mktemp("shot"), **slide)


def composited(shot, out: Path, *, renderer, losses="0"):
    """Decoded frames of a run of its own process, and what it said."""
    words = [
        str(shot / "in.mp4"),
        str(shot / "anim.glb"),
        str(out),
        "--fit",
        str(shot / "fit.json"),
    ]
    words += ["--codec", "ffv1", "--preset", "realtime", "--no-progress"]
    done = subprocess.run(
        [sys.executable, "-c", LOSING, losses, *words], capture_output=True, text=True,
        timeout=200, env={**os.environ, "NLENS_RENDERER": renderer}, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    with av.open(str(out)) as container:
        return [frame.to_ndarray() for frame in container.decode(video=0)], done.stderr


def test_run_that_loses_its_display_keeps_every_frame_and_notes_it(shot, tmp_path):
    by_opengl, quiet = composited(shot, tmp_path / "gl.mkv", renderer="opengl")
    by_software, _ = composited(shot, tmp_path / "soft.mkv", renderer="software")
    twice, said = composited(shot, tmp_path / "twice.mkv", renderer="opengl", losses="5,9")
    assert len(by_opengl) == len(by_software) == len(twice) == 12
    assert "OpenGL was lost" not in quiet
    assert said.count("OpenGL was lost") == 2 and "Traceback" not in said
    assert (
        said.count("a new context draws on") == said.count("the software rasteriser draws on") == 1
    )
    assert_same([twice[:7]], [by_opengl[:7]])
    assert_same([twice[8:]], [by_software[8:]])
    apart = [np.abs(a.astype(int) - b).max() for a, b in zip(twice, by_opengl, strict=True)]
    assert 0 < max(apart), "the two renderers differ in their antialiasing"
