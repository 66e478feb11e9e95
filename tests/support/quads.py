"""Quads with materials, and a camera on the z axis, for tests of the renderers."""

import numpy as np
from support.glb_builder import QUAD, QUAD_FACES

from nlens_video.scene import Camera, Scene

NORMALS = np.tile(np.array([[0, 0, 1]], np.float32), (4, 1))


LAMBERT = {"KHR_materials_specular": {"specularFactor": 0}}


def camera_at(z, width=64, height=64, **changes):
    """A camera on the z axis looking at the origin; a unit at the origin is 20 px."""
    pose = np.eye(4)
    pose[2, 3] = z
    f = 20.0 * z
    values = {"fx": f, "fy": f, "cx": width / 2, "cy": height / 2}
    values |= {"width": width, "height": height, **changes}
    return Camera(world_from_camera=pose, **values)


def material(builder, color=(1, 1, 1, 1), extensions=LAMBERT, **fields):
    pbr = {"baseColorFactor": list(color), "metallicFactor": 0, "roughnessFactor": 1}
    pbr |= fields.pop("pbr", {})
    return builder.add(
        "materials", {"pbrMetallicRoughness": pbr, "extensions": extensions, **fields}
    )


def quad(builder, positions=QUAD, number=None, node=None, **attributes):
    mesh = builder.mesh(positions, QUAD_FACES, material=number, NORMAL=NORMALS, **attributes)
    return builder.node(mesh=mesh, **(node or {}))


def unlit(builder, color=(1, 1, 1, 1), **fields):
    return material(builder, color, {"KHR_materials_unlit": {}}, **fields)


def draw(renderer_class, builder, folder, camera=None, time_s=0.0, margin=0):
    """What a renderer draws of the builder's scene."""
    scene = Scene.load(builder.write(folder / "scene.glb"))
    with renderer_class(scene) as renderer:
        return renderer.render(time_s, camera or camera_at(4.0), margin)
