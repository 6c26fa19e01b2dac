"""The unit primitives as fine triangle meshes with texture coordinates, for renderers that know no other shapes.

Same object space and same places on the texture as `intersections` and `surfaces`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flightdepth.scenes.scene import Floats, Shape

FACE_CELLS = 32  # a cube's face is cut too: places on small triangles keep more digits in 32-bit floats


@dataclass(frozen=True)
class Mesh:
    """Smooth surfaces: corners that share a vertex share its normal.

    vertices    [V, 3]
    triangles   [T, 3] int32    counter-clockwise seen from outside
    uv          [T, 3, 2]       place on the texture of each corner, 0..1
    """

    vertices: Floats
    triangles: NDArray[np.int32]
    uv: NDArray[np.float32]


def primitive(shape: Shape, torus_radius: float, segments: int) -> Mesh:
    """Any unit primitive; `segments` round the axis of what is round (four times as many for a cone, where
    they are cheap).
    """
    if shape is Shape.CUBE:
        return _joined([cube_face(part) for part in range(6)])
    if shape is Shape.SPHERE:
        return _sphere(segments)
    return _cone(4 * segments) if shape is Shape.CONE else _torus(torus_radius, segments)


def cube_face(part: int) -> Mesh:
    """Face -x, +x, -y, +y, -z or +z of the cube |x|, |y|, |z| <= 1."""
    axis, sign = part // 2, 2.0 * (part % 2) - 1.0
    first, second = [other for other in range(3) if other != axis]
    u, v = _lattice(FACE_CELLS, FACE_CELLS)
    vertices = np.empty((*u.shape, 3))
    vertices[..., axis], vertices[..., first], vertices[..., second] = sign, 2 * u - 1, 2 * v - 1
    # first x second points along +axis for x and z, along -y for y
    return _grid(vertices, u, v, flip=(sign > 0) == (axis == 1))


def _sphere(segments: int) -> Mesh:
    u, v = _lattice(segments, segments // 2)
    around, down = (2 * u - 1) * np.pi, v * np.pi
    ring = np.sin(down)
    return _grid(_stack(ring * np.cos(around), ring * np.sin(around), np.cos(down)), u, v, flip=True)


def _torus(radius: float, segments: int) -> Mesh:
    u, v = _lattice(segments, segments // 2)
    around, about = (2 * u - 1) * np.pi, (2 * v - 1) * np.pi
    ring = 1 + radius * np.cos(about)
    vertices = _stack(ring * np.cos(around), ring * np.sin(around), radius * np.sin(about))
    return _grid(vertices, u, v, flip=False)


def _cone(segments: int) -> Mesh:
    """The side, a triangle per segment with an apex of its own, which keeps normals apart there; then the base."""
    u = np.arange(segments + 1) / segments
    rim = _stack(np.cos((2 * u - 1) * np.pi), np.sin((2 * u - 1) * np.pi), np.full(len(u), -1.0))
    here = np.arange(segments)
    there = (here + 1) % segments
    apexes = np.broadcast_to([0.0, 0.0, 1.0], (segments, 3))
    low, high = np.zeros(segments), np.ones(segments)
    side_uv = np.stack([_stack(u[:-1], low), _stack(u[1:], low), _stack(u[:-1] + 0.5 / segments, high)], 1)
    side = Mesh(np.concatenate([rim[:-1], apexes]), _ints(here, there, segments + here), _floats(side_uv))
    vertices = np.concatenate([rim[:-1], [[0.0, 0.0, -1.0]]])
    triangles = _ints(there, here, np.full(segments, segments))
    return _joined([side, Mesh(vertices, triangles, _floats(0.5 + 0.5 * vertices[triangles][..., :2]))])


def _lattice(columns: int, rows: int) -> tuple[Floats, Floats]:
    """u and v in 0..1, [columns + 1, rows + 1] each."""
    u, v = np.meshgrid(np.arange(columns + 1) / columns, np.arange(rows + 1) / rows, indexing="ij")
    return u, v


def _grid(vertices: Floats, u: Floats, v: Floats, *, flip: bool) -> Mesh:
    """Two triangles a cell of a surface [I, J, 3]; borders that lie on each other are welded, points are not."""
    index = np.arange(u.size).reshape(u.shape)
    if np.allclose(vertices[0], vertices[-1], atol=1e-9):
        index[-1] = index[0]
    if np.allclose(vertices[:, 0], vertices[:, -1], atol=1e-9):
        index[:, -1] = index[:, 0]
    places = np.arange(u.size).reshape(u.shape)  # on the texture, where welded borders stay apart
    cells = np.stack([places[:-1, :-1], places[1:, :-1], places[1:, 1:], places[:-1, 1:]], -1).reshape(-1, 4)
    order = np.array([[0, 2, 1], [0, 3, 2]] if flip else [[0, 1, 2], [0, 2, 3]])
    corners = cells[:, order].reshape(-1, 3)
    triangles = index.ravel()[corners]
    p = vertices.reshape(-1, 3)[triangles]
    area = np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1)
    real = area > 1e-12  # at a pole one of a cell's two triangles has no area
    uv = np.stack([u.ravel()[corners], v.ravel()[corners]], -1)
    return Mesh(vertices.reshape(-1, 3), _ints(*triangles[real].T), _floats(uv[real]))


def _joined(meshes: list[Mesh]) -> Mesh:
    starts = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes[:-1]])
    triangles = [mesh.triangles + start for mesh, start in zip(meshes, starts, strict=True)]
    return Mesh(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate(triangles).astype(np.int32),
        np.concatenate([mesh.uv for mesh in meshes]),
    )


def _stack(*parts: Floats) -> Floats:
    return np.stack(parts, -1)


def _ints(*columns: NDArray[np.int64]) -> NDArray[np.int32]:
    return np.stack(columns, -1).astype(np.int32)


def _floats(values: Floats) -> NDArray[np.float32]:
    return values.astype(np.float32)
