"""Which meshes bound a volume: the same answers as trimesh gives, which takes long to load."""

import numpy as np
import pytest
import trimesh

from nlens_video.render.base.drawer import _closes

MESHES = {
    "ball": trimesh.creation.icosphere(2),
    "box": trimesh.creation.box(),
    "cylinder": trimesh.creation.cylinder(1.0, 2.0, sections=17),
    "ring": trimesh.creation.torus(1.0, 0.3, 12, 8),
}


def soup(corners, faces):
    return corners[faces].reshape(-1, 3), np.arange(faces.size).reshape(-1, 3)


CHANGES = {
    "none": lambda v, f: (v, f),
    "inside out": lambda v, f: (v, f[:, ::-1]),
    "a face is missing": lambda v, f: (v, f[:-1]),
    "a face is there twice": lambda v, f: (v, np.vstack([f, f[:1]])),
    "a face is turned": lambda v, f: (v, np.vstack([f[:-1], f[-1:, ::-1]])),
    "no vertex is shared": soup,
    "an edge of no length": lambda v, f: (v, np.vstack([f, [[f[0, 0], f[0, 0], f[0, 1]]]])),
    "two of it": lambda v, f: (np.vstack([v, v + 3.0]), np.vstack([f, f + len(v)])),
    "one of two inside out": lambda v, f: (
        np.vstack([v, 2.0 * v]), np.vstack([f[:, ::-1], f + len(v)])
    ),
    "flat": lambda v, f: (v * [1.0, 0.0, 1.0], f),
}  # fmt: skip


@pytest.mark.parametrize("change", CHANGES)
@pytest.mark.parametrize("mesh", MESHES)
def test_a_mesh_closes_as_trimesh_finds(mesh, change):
    vertices, faces = CHANGES[change](np.array(MESHES[mesh].vertices), np.array(MESHES[mesh].faces))
    vertices, faces = vertices.astype(np.float32), np.ascontiguousarray(faces, np.int32)
    defined = trimesh.Trimesh(vertices, faces, process=True)
    defined.update_faces(np.array([len(set(face)) == 3 for face in defined.faces.tolist()]))
    if change != "flat":  # of whose volume only rounding is left
        assert _closes(vertices, faces) == defined.is_volume
    for seed in range(3):
        mixed = np.random.default_rng(seed).permutation(faces)
        assert _closes(vertices, mixed) == _closes(vertices, faces)


def test_without_extent_or_without_faces_nothing_closes():
    faces = np.array([[0, 1, 2]], np.int32)
    assert not _closes(np.zeros((3, 3), np.float32), faces)
    assert not _closes(np.full((3, 3), np.nan, np.float32), faces)
    assert not _closes(np.eye(3, dtype=np.float32), np.zeros((0, 3), np.int32))
