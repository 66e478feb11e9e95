"""Selection of the renderer, with and without OpenGL."""

import os
import subprocess
import sys

import numpy as np
import pytest
from support.glb_builder import GlbBuilder
from support.quads import camera_at, quad, unlit

from nlens_video.core.errors import UsageError
from nlens_video.render import select
from nlens_video.render.software.renderer import SoftwareObjectRenderer
from nlens_video.scene import Scene


@pytest.fixture
def scene(tmp_path):
    builder = GlbBuilder()
    quad(builder, number=unlit(builder))
    return Scene.load(builder.write(tmp_path / "scene.glb"))


def test_environment_variable_selects_the_renderer(scene, monkeypatch):
    monkeypatch.setenv("NLENS_RENDERER", "software")
    with select.choose_renderer(scene) as renderer:
        assert isinstance(renderer, SoftwareObjectRenderer)
        assert "software rasteriser (NLENS_RENDERER=software)" in renderer.description
    monkeypatch.setenv("NLENS_RENDERER", "opengl")
    with select.choose_renderer(scene) as renderer:
        assert "OpenGL (NLENS_RENDERER=opengl)" in renderer.description


def test_unknown_renderer_name_error_lists_the_renderers(scene, monkeypatch):
    monkeypatch.setenv("NLENS_RENDERER", "vulkan")
    with pytest.raises(
        UsageError, match="NLENS_RENDERER=vulkan: expected auto, opengl or software"
    ):
        select.choose_renderer(scene)


@pytest.mark.slow
def test_without_a_graphics_device_the_rasteriser_is_used_and_opengl_is_not_loaded(scene, tmp_path):
    program = f"""
import pathlib, sys
import nlens_video.render.select as choose
choose._DEVICES = ()
from nlens_video.scene import Camera, Scene
import numpy as np
pose = np.eye(4); pose[2, 3] = 4.0
camera = Camera(world_from_camera=pose, fx=80, fy=80, cx=32, cy=32, width=64, height=64)
scene = Scene.load(pathlib.Path({str(scene.path)!r}))
with choose.choose_renderer(scene) as renderer:
    print(renderer.description, renderer.render(0.0, camera).rgba[..., 3].sum())
print(sorted({{"OpenGL", "pyrender", "trimesh"}} & set(sys.modules)))
"""
    run = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True,
        env={**os.environ, "NLENS_RENDERER": "auto"}, timeout=300,
    )  # fmt: skip
    described, loaded = run.stdout.splitlines()
    assert described == "software rasteriser (no graphics device), the object's box only 1600.0"
    assert loaded == "[]"


def test_failing_opengl_is_reported_and_the_rasteriser_used(scene, monkeypatch):
    monkeypatch.setenv("EGL_DEVICE_ID", "99")
    monkeypatch.delenv("NLENS_RENDERER", raising=False)
    monkeypatch.setattr(select, "_DEVICES", ("null",))  # /dev/null is there always
    select._why_no_graphics.cache_clear()
    try:
        with select.choose_renderer(scene) as renderer:
            assert isinstance(renderer, SoftwareObjectRenderer)
            assert "OpenGL cannot start" in renderer.description
            assert np.isfinite(renderer.render(0.0, camera_at(4.0)).depth).any()
    finally:
        select._why_no_graphics.cache_clear()


@pytest.mark.needs_gl
def test_software_opengl_is_replaced_by_the_rasteriser(scene, monkeypatch):
    from nlens_video.render.opengl.egl_platform import describe, open_platform

    platform = open_platform()
    on_processor = "llvmpipe" in describe()
    platform.delete_context()
    monkeypatch.delenv("NLENS_RENDERER", raising=False)
    monkeypatch.setattr(select, "_DEVICES", ("null",))
    select._why_no_graphics.cache_clear()
    try:
        with select.choose_renderer(scene) as renderer:
            assert isinstance(renderer, SoftwareObjectRenderer) == on_processor
    finally:
        select._why_no_graphics.cache_clear()
