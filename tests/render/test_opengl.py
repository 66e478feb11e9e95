"""Failures of the OpenGL renderer: threads, drivers, devices."""

import threading

import numpy as np
import pytest
from support.glb_builder import QUAD_UV, GlbBuilder
from support.quads import camera_at, draw, quad, unlit

from nlens_video.core.errors import NlensError
from nlens_video.render.opengl.object_renderer import PyrenderObjectRenderer
from nlens_video.scene import Scene

pytestmark = pytest.mark.needs_gl


def test_use_from_another_thread_or_after_closing_is_refused(tmp_path):
    builder = GlbBuilder()
    quad(builder, number=unlit(builder))
    scene = Scene.load(builder.write(tmp_path / "scene.glb"))
    renderer = PyrenderObjectRenderer(scene)
    renderer.render(0.0, camera_at(4.0))
    caught = []

    def elsewhere():
        with pytest.raises(NlensError, match="thread") as raised:
            renderer.render(0.0, camera_at(4.0))
        caught.append(raised.value)

    thread = threading.Thread(target=elsewhere)
    thread.start()
    thread.join()
    assert len(caught) == 1
    renderer.close()
    renderer.close()
    with pytest.raises(NlensError, match="closed"):
        renderer.render(0.0, camera_at(4.0))


def test_missing_graphics_device_error_states_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setenv("EGL_DEVICE_ID", "99")
    builder = GlbBuilder()
    quad(builder, number=unlit(builder))
    with pytest.raises(NlensError, match="apt-get install libegl1 libgl1") as raised:
        draw(PyrenderObjectRenderer, builder, tmp_path)
    assert "\n" not in str(raised.value)


def test_texture_too_large_for_the_driver_is_refused_and_leaves_no_context(tmp_path, monkeypatch):
    from nlens_video.render.opengl.egl_platform import HeadlessPlatform

    deleted = []
    delete_context = HeadlessPlatform.delete_context

    def recorded(platform):
        delete_context(platform)
        deleted.append(platform._egl_context is None)

    monkeypatch.setattr(HeadlessPlatform, "delete_context", recorded)
    builder = GlbBuilder()
    # Beyond all known drivers' GL_MAX_TEXTURE_SIZE.
    info = {"index": builder.texture(np.zeros((1, 70_000, 3)))}
    quad(builder, number=unlit(builder, pbr={"baseColorTexture": info}), TEXCOORD_0=QUAD_UV)
    with pytest.raises(NlensError, match="cannot hold the object .*; export") as raised:
        draw(PyrenderObjectRenderer, builder, tmp_path)
    assert "\n" not in str(raised.value)
    assert deleted[0] is True


def test_picture_too_large_for_the_driver_is_refused_in_one_line(tmp_path):
    builder = GlbBuilder()
    quad(builder, number=unlit(builder), node={"scale": [1e6, 1, 1]})
    wide = camera_at(4.0, width=70_000)
    with pytest.raises(NlensError, match="cannot draw a picture of 70000x42 pixels") as raised:
        draw(PyrenderObjectRenderer, builder, tmp_path, wide)
    assert "\n" not in str(raised.value)
