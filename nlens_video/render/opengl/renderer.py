"""pyrender's renderer with linear light, correct blending and exact depth.

pyrender manages the scene graph, shader programs and GPU objects. Its forward pass is replaced: it
writes 8-bit display-coded colour, squares alpha and ignores the alpha cutoff.
"""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pyrender
from OpenGL import GL
from pyrender.shader_program import ShaderProgram, ShaderProgramCache

from nlens_video.core.layers import Float32, Float64
from nlens_video.render.base.drawer import (
    BehindPicture,
    FrontSurfaces,
    ViewSetup,
    closed_bodies,
)
from nlens_video.render.base.shader_inputs import MATERIAL_FLOATS, SLOTS
from nlens_video.render.opengl.gpu_objects import (
    BehindTarget,
    FloatTarget,
    GpuMaterial,
    GpuPrimitive,
)
from nlens_video.render.opengl.gpu_textures import GpuTexture
from nlens_video.render.opengl.stacked_texture import StackedTexture
from nlens_video.scene.gltf.materials import Material
from nlens_video.scene.gltf.textures import Image
from nlens_video.scene.posed import PosedScene

_SHADERS = Path(__file__).parent / "shaders"
_FRAME, _MATERIAL = 0, 1
_LIMIT_UNIT = len(SLOTS)
_SURROUND_UNIT = _LIMIT_UNIT + 1
_DEPTH_UNIT = _SURROUND_UNIT + 1


class LinearRenderer(pyrender.Renderer):  # type: ignore[misc]  # untyped base
    """Draws one posed scene; needs a current context from construction to `delete`."""

    def __init__(self, posed: PosedScene) -> None:
        super().__init__(1, 1)
        self._program_cache = ShaderProgramCache(shader_dir=str(_SHADERS))
        self._ready: set[ShaderProgram] = set()
        self._target = FloatTarget()
        self._behind = BehindTarget()
        self._surround = StackedTexture(GL.GL_RGBA32F, GL.GL_RGBA, GL.GL_LINEAR)
        self._depth_maps = StackedTexture(GL.GL_R32F, GL.GL_RED, GL.GL_NEAREST)
        self._defines: dict[str, int] = {}
        self._one_sided: frozenset[GpuPrimitive] | None = None  # computed on first use
        self._empty = int(GL.glGenVertexArrays(1))
        self._blocks: list[int] = [int(name) for name in GL.glGenBuffers(2)]
        textures: dict[Image, GpuTexture] = {}
        twins: dict[Material, GpuMaterial] = {}
        for mesh in posed.meshes:
            material = mesh.geometry.material
            if material not in twins:
                twins[material] = GpuMaterial(material, textures)
        self._primitives = [
            GpuPrimitive(mesh, twins[mesh.geometry.material]) for mesh in posed.meshes
        ]
        self._scene = pyrender.Scene()
        self._scene.add(pyrender.Mesh(primitives=list(self._primitives)))
        self._update_context(self._scene, pyrender.RenderFlags.NONE)
        self._offsets = self._upload_materials(list(twins.values()))

    def _upload_materials(self, materials: list[GpuMaterial]) -> dict[GpuMaterial, int]:
        alignment = int(GL.glGetIntegerv(GL.GL_UNIFORM_BUFFER_OFFSET_ALIGNMENT))
        stride = -(-4 * MATERIAL_FLOATS // alignment) * alignment
        data = np.zeros((len(materials), stride // 4), np.float32)
        for row, material in zip(data, materials, strict=True):
            row[:MATERIAL_FLOATS] = material.block
        GL.glBindBuffer(GL.GL_UNIFORM_BUFFER, self._blocks[_MATERIAL])
        GL.glBufferData(GL.GL_UNIFORM_BUFFER, data.nbytes, data, GL.GL_STATIC_DRAW)
        return {material: stride * index for index, material in enumerate(materials)}

    def draw(self, view: ViewSetup) -> tuple[Float32, Float32]:
        """See `Drawer`."""
        self._defines = view.lighting.defines
        self._take_up(view)
        self._begin(self._target, view)
        self._draw_opaque()
        self._draw_blended(view)
        self._resolve(self._target, view, "resolve_nearest" if view.nearest else "resolve")
        return self._target.read(view.box.width, view.box.height)

    def draw_behind(self, view: ViewSetup, front: FrontSurfaces) -> BehindPicture | None:
        """See `Drawer`.

        Blended materials are in front alone, and what comes through them is not.
        """
        self._defines = {**view.lighting.defines, "USE_LIMIT": 1, "USE_BEHIND": 1}
        self._take_up(view)
        self._begin(self._behind.target, view)
        self._behind.bind_limit(front.limit(view.near, view.far), _LIMIT_UNIT)
        if self._one_sided is None:
            closed = closed_bodies(view.posed.meshes)
            self._one_sided = frozenset(itertools.compress(self._primitives, closed))
        if not self._behind.shows(lambda: self._draw_opaque(self._one_sided)):
            return None
        self._resolve(self._behind.target, view, "resolve")
        rgba, depth = self._behind.target.read(view.box.width, view.box.height)
        samples, corner = self._target, front.corner
        if any(primitive.material.source.see_through for primitive in self._primitives):
            samples, corner = self._behind.target, (0, 0)
            self._begin(samples, view)
            self._defines = {**view.lighting.defines, "USE_LIMIT": 1, "USE_FRONT": 1}
            self._draw_opaque()
            self._defines = view.lighting.defines
            self._draw_blended(view)
        program = self._program("front", {})
        program._bind()
        number = program._program_id
        self._behind.target.bind_resolved(samples=samples)
        GL.glUniform2i(GL.glGetUniformLocation(number, "corner"), *corner)
        GL.glUniform1f(GL.glGetUniformLocation(number, "reach"), front.step(view.near, view.far))
        self._fill_view(program)
        front_rgba, _ = self._behind.target.read(view.box.width, view.box.height)
        return BehindPicture(rgba=rgba, depth=depth, front_rgba=front_rgba)

    def _take_up(self, view: ViewSetup) -> None:
        for primitive, mesh in zip(self._primitives, view.posed.meshes, strict=True):
            primitive.update(mesh)
        rotation = view.camera.camera_from_world.copy()
        rotation[:3, 3] = 0.0
        block = view.lighting.frame_block(_projection(view) @ rotation, _eye(view))
        GL.glBindBufferBase(GL.GL_UNIFORM_BUFFER, _FRAME, self._blocks[_FRAME])
        GL.glBufferData(GL.GL_UNIFORM_BUFFER, block.nbytes, block, GL.GL_DYNAMIC_DRAW)
        if view.lighting.surround is not None:
            self._surround.bind(_SURROUND_UNIT, view.lighting.surround)
        if (depth := view.lighting.depth) is not None:
            self._depth_maps.bind(_DEPTH_UNIT, depth.nearness, depth.highest)

    def _begin(self, target: FloatTarget, view: ViewSetup) -> None:
        GL.glDepthMask(GL.GL_TRUE)
        GL.glColorMask(GL.GL_TRUE, GL.GL_TRUE, GL.GL_TRUE, GL.GL_TRUE)
        target.bind(view.box.width, view.box.height)
        GL.glEnable(GL.GL_MULTISAMPLE)
        GL.glEnable(GL.GL_DEPTH_TEST)
        GL.glDepthFunc(GL.GL_LEQUAL)
        GL.glDisable(GL.GL_BLEND)
        GL.glCullFace(GL.GL_BACK)
        GL.glVertexAttrib4f(3, 1.0, 1.0, 1.0, 1.0)  # vertex colour where a mesh has none

    def _draw_opaque(self, one_sided: frozenset[GpuPrimitive] | None = None) -> None:
        for primitive in self._primitives:
            material = primitive.material.source
            if not material.see_through:
                both_sides = material.double_sided and primitive not in (one_sided or ())
                self._draw_primitive(primitive, both_sides=both_sides)

    def _draw_blended(self, view: ViewSetup) -> None:
        back, eye = view.camera.camera_from_world[2, :3], _eye(view)
        depths = [
            (primitive.depth_along(back, eye), primitive)
            for primitive in self._primitives
            if primitive.material.source.see_through
        ]
        if not depths:
            return
        depths.sort(key=lambda pair: -float(pair[0].mean()))
        GL.glEnable(GL.GL_BLEND)
        GL.glBlendFuncSeparate(
            GL.GL_ONE, GL.GL_ONE_MINUS_SRC_ALPHA, GL.GL_ONE, GL.GL_ONE_MINUS_SRC_ALPHA
        )
        GL.glDepthMask(GL.GL_FALSE)
        for depth, primitive in depths:
            primitive.sort(depth)
            self._draw_primitive(primitive, both_sides=primitive.material.source.double_sided)
        # Depth only after all colour: a near layer must not hide a far one that is drawn later.
        GL.glDisable(GL.GL_BLEND)
        GL.glDepthMask(GL.GL_TRUE)
        GL.glColorMask(GL.GL_FALSE, GL.GL_FALSE, GL.GL_FALSE, GL.GL_FALSE)
        for _, primitive in depths:
            self._draw_primitive(primitive, both_sides=primitive.material.source.double_sided)
        GL.glColorMask(GL.GL_TRUE, GL.GL_TRUE, GL.GL_TRUE, GL.GL_TRUE)

    def _draw_primitive(self, primitive: GpuPrimitive, *, both_sides: bool) -> None:
        material: GpuMaterial = primitive.material
        program = self._program("object", {**material.defines, **self._defines})
        program._bind()
        GL.glBindBufferRange(
            GL.GL_UNIFORM_BUFFER,
            _MATERIAL,
            self._blocks[_MATERIAL],
            self._offsets[material],
            4 * MATERIAL_FLOATS,
        )
        for slot, texture in material.maps.items():
            GL.glActiveTexture(GL.GL_TEXTURE0 + SLOTS.index(slot))
            texture._bind()
        if both_sides:
            GL.glDisable(GL.GL_CULL_FACE)
        else:
            GL.glEnable(GL.GL_CULL_FACE)
        # The picture's rows run downwards in clip space, which turns every triangle over.
        GL.glFrontFace(GL.GL_CCW if primitive.mirrored else GL.GL_CW)
        primitive.draw()

    def _resolve(self, target: FloatTarget, view: ViewSetup, name: str) -> None:
        program = self._program(name, {})
        program._bind()
        target.bind_resolved()
        number = program._program_id
        GL.glUniform2f(GL.glGetUniformLocation(number, "clip_range"), view.near, view.far)
        size = GL.glGetUniformLocation(number, "size")
        if size >= 0:
            GL.glUniform2i(size, view.box.width, view.box.height)
        self._fill_view(program)

    def _fill_view(self, program: ShaderProgram) -> None:
        """Run a bound program once for every pixel of what is bound to be drawn into."""
        GL.glDisable(GL.GL_DEPTH_TEST)
        GL.glDisable(GL.GL_CULL_FACE)
        GL.glBindVertexArray(self._empty)
        GL.glDrawArrays(GL.GL_TRIANGLES, 0, 3)
        program._unbind()

    def _program(self, name: str, defines: dict[str, int]) -> ShaderProgram:
        vertex = name.partition("_")[0]
        program = self._program_cache.get_program(f"{vertex}.vert", f"{name}.frag", defines=defines)
        if program not in self._ready:
            program._add_to_context()
            self._connect(program._program_id)
            self._ready.add(program)
        return program

    @staticmethod
    def _connect(number: int) -> None:
        """Tell a program, once, where its blocks and textures are bound."""
        GL.glUseProgram(number)
        for binding, block in ((_FRAME, "FrameBlock"), (_MATERIAL, "MaterialBlock")):
            index = GL.glGetUniformBlockIndex(number, block)
            if index != GL.GL_INVALID_INDEX:
                GL.glUniformBlockBinding(number, index, binding)
        samplers = [(f"{slot}_map", unit) for unit, slot in enumerate(SLOTS)]
        samplers += [("color_samples", 0), ("depth_samples", 1), ("limit", _LIMIT_UNIT)]
        samplers += [("surround_map", _SURROUND_UNIT), ("depth_maps", _DEPTH_UNIT)]
        for sampler, unit in samplers:
            location = GL.glGetUniformLocation(number, sampler)
            if location >= 0:
                GL.glUniform1i(location, unit)

    def delete(self) -> None:
        """Free all GPU objects, in the reverse order of their making."""
        self._target.delete()
        self._behind.delete()
        self._surround.delete()
        self._depth_maps.delete()
        super().delete()
        self._ready.clear()
        if self._blocks:
            GL.glDeleteBuffers(len(self._blocks), self._blocks)
            GL.glDeleteVertexArrays(1, [self._empty])
            self._blocks = []

    def __del__(self) -> None:
        """Nothing: freeing needs the context, which only the owner can make current."""


def _eye(view: ViewSetup) -> Float64:
    """The camera's place in the world (3,) [scene unit]."""
    return view.camera.world_from_camera[:3, 3]


def _projection(view: ViewSetup) -> Float64:
    """Clip space of a box of the frame (4, 4); row 0 of the box lies at clip y = -1."""
    camera, box, near, far = view.camera, view.box, view.near, view.far
    matrix = np.zeros((4, 4))
    matrix[0, 0] = 2.0 * camera.fx / box.width
    matrix[0, 2] = 1.0 - 2.0 * (camera.cx - box.x0) / box.width
    matrix[1, 1] = -2.0 * camera.fy / box.height
    matrix[1, 2] = 1.0 - 2.0 * (camera.cy - box.y0) / box.height
    matrix[2, 2] = -(far + near) / (far - near)
    matrix[2, 3] = -2.0 * far * near / (far - near)
    matrix[3, 2] = -1.0
    return matrix
