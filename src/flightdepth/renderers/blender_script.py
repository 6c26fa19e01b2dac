"""Runs inside Blender, or in a Python that has bpy: renders scenes for `blender_process` until its input ends.

A line of JSON in asks for a scene; a line out for every frame says that its file stands. All of Blender's own
chatter goes to the error output. This file imports nothing of the package: Blender has a Python of its own.
"""

from __future__ import annotations

import json
import os
import sys
import time
from pathlib import Path
from typing import Any

import bpy  # type: ignore[import-not-found]
import numpy as np
from mathutils import Matrix  # type: ignore[import-not-found]

PREFIX = "flightdepth "  # of an answer
EDGE = 512  # texels of a texture
EXPONENT = 32.0  # of the highlight
FAR_M = 1e6


def main() -> None:
    """Answer requests."""
    answers = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(2, 1)

    def answer(**fields: Any) -> None:
        answers.write(PREFIX + json.dumps(fields) + "\n")

    _empty_file()
    answer(ready=bpy.app.version_string)
    for line in sys.stdin:
        try:
            for frame in _render(json.loads(line)):
                answer(frame=frame, processor_s=time.process_time())
        except Exception as error:  # the other side raises it
            answer(error=f"{type(error).__name__}: {error}")


def _empty_file() -> None:
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    scene.collection.objects.link(scene.camera)
    scene.world = bpy.data.worlds.new("sky")
    _quiet_cycles(scene)
    settings = scene.render.image_settings
    settings.file_format, settings.color_depth, settings.exr_codec = "OPEN_EXR_MULTILAYER", "32", "NONE"
    scene.view_layers[0].use_pass_z = True


def _quiet_cycles(scene: Any) -> None:
    """Direct light only, and nothing that guesses: no denoising, no thresholds, no clamping."""
    scene.render.engine = "CYCLES"
    scene.render.use_persistent_data = True
    scene.render.use_compositing = scene.render.use_sequencer = False
    cycles = scene.cycles
    cycles.device, cycles.seed = "CPU", 0
    cycles.use_adaptive_sampling = cycles.use_denoising = cycles.use_auto_tile = False
    cycles.max_bounces = 0
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = cycles.light_sampling_threshold = 0.0
    # Data passes are written by the first sample, which goes through the pixel's centre.
    cycles.pixel_filter_type, cycles.filter_width = "BOX", 1.0


def _render(request: dict[str, Any]) -> Any:
    """Build the scene, then write frame after frame; yields each number."""
    scene = bpy.context.scene
    _clear(set(request["meshes"]))
    with np.load(request["scene"], allow_pickle=False) as arrays:
        data = dict(arrays)
    for name, path in request["meshes"].items():
        if name not in bpy.data.meshes:
            _add_mesh(name, Path(path))
    material = _surface(request["atlas"], data)
    root = bpy.data.objects.new("root", None)
    scene.collection.objects.link(root)
    for place, name in enumerate(request["objects"]):
        _add_object(scene, root, bpy.data.meshes[name], material, data, place)
    _add_lamps(scene, data)
    _set_sky(scene.world, data["sky"])
    _set_camera(scene, request)
    for frame, pose in enumerate(data["camera"]):
        scene.camera.matrix_world = _matrix(pose)
        scene.render.filepath = request["frames"].format(frame)
        bpy.ops.render.render(write_still=True)
        yield frame


def _clear(kept_meshes: set[str]) -> None:
    """Remove what the last scene left, but for meshes that are wanted again."""
    camera = bpy.context.scene.camera
    bpy.data.batch_remove([thing for thing in bpy.data.objects if thing != camera])
    bpy.data.batch_remove([mesh for mesh in bpy.data.meshes if mesh.name not in kept_meshes])
    bpy.data.batch_remove([*bpy.data.lights, *bpy.data.materials, *bpy.data.images])


def _add_mesh(name: str, path: Path) -> None:
    with np.load(path, allow_pickle=False) as arrays:
        vertices, triangles, uv = arrays["vertices"], arrays["triangles"], arrays["uv"]
    mesh = bpy.data.meshes.new(name)
    mesh.vertices.add(len(vertices))
    mesh.vertices.foreach_set("co", vertices.astype(np.float32).ravel())
    mesh.loops.add(triangles.size)
    mesh.loops.foreach_set("vertex_index", triangles.ravel())
    mesh.polygons.add(len(triangles))
    mesh.polygons.foreach_set("loop_start", np.arange(0, triangles.size, 3, dtype=np.int32))
    mesh.polygons.foreach_set("loop_total", np.full(len(triangles), 3, dtype=np.int32))
    mesh.polygons.foreach_set("use_smooth", np.ones(len(triangles), dtype=bool))
    mesh.uv_layers.new(name="place").data.foreach_set("uv", uv.ravel())
    mesh.materials.append(None)
    mesh.update(calc_edges=True)


def _add_object(scene: Any, root: Any, mesh: Any, material: Any, data: dict[str, Any], place: int) -> None:
    """The mesh in its place. What it looks like it says itself, so that all objects share one material."""
    mesh.materials[0] = material
    thing = bpy.data.objects.new(f"thing {place}", mesh)
    # Blender would break a pose up into turn and scale, which loses shear; this matrix it takes as it is.
    thing.parent, thing.matrix_parent_inverse = root, _matrix(data["pose"][place])
    for name in ("u_row", "v_row", "tile", "tint"):
        thing[name] = data[name][place].tolist()
    thing["shine"] = float(data["shine"][place])
    scene.collection.objects.link(thing)


def _add_lamps(scene: Any, data: dict[str, Any]) -> None:
    for position, power in zip(data["lamp_position"], data["lamp_power"], strict=True):
        light = bpy.data.lights.new("lamp", "POINT")
        light.energy, light.color = power.max(), power / power.max()
        light.shadow_soft_size = 0.0  # hard shadows
        light.cycles.use_multiple_importance_sampling = False
        lamp = bpy.data.objects.new("lamp", light)
        lamp.location = position
        scene.collection.objects.link(lamp)


def _set_camera(scene: Any, request: dict[str, Any]) -> None:
    render, lens, camera = scene.render, request["lens"], scene.camera.data
    render.resolution_x, render.resolution_y = request["width"], request["height"]
    render.resolution_percentage = 100
    render.pixel_aspect_x, render.pixel_aspect_y = lens["aspect_x"], lens["aspect_y"]
    camera.sensor_fit, camera.sensor_width, camera.lens = "HORIZONTAL", request["sensor_mm"], lens["lens_mm"]
    camera.shift_x, camera.shift_y = lens["shift_x"], lens["shift_y"]
    camera.clip_start, camera.clip_end = 1e-3, FAR_M
    scene.cycles.samples = request["samples"]
    if request["threads"]:
        render.threads_mode, render.threads = "FIXED", request["threads"]


def _surface(atlas: str, data: dict[str, Any]) -> Any:
    """Matt surface, highlight and an ambient share, all read from the object that wears it."""
    material = bpy.data.materials.new("surface")
    material.use_nodes = True
    if hasattr(material.cycles, "emission_sampling"):  # 3.5 and newer
        material.cycles.emission_sampling = "NONE"
    else:
        material.cycles.sample_as_light = False
    nodes = _Nodes(material.node_tree)
    albedo = _albedo(nodes, atlas, data["atlas_size"].tolist())
    matt = nodes.add("BsdfDiffuse", Color=albedo)
    seen = nodes.add("LightPath").out("Is Camera Ray")  # else a surface would light its neighbours
    ambient = nodes.vector("MULTIPLY", albedo, data["ambient"].tolist())
    glow = nodes.add("Emission", Color=ambient, Strength=seen)
    shining = nodes.add("BsdfAnisotropic")
    shining.node.distribution = "ASHIKHMIN_SHIRLEY"
    shining.node.inputs["Roughness"].default_value = (2.0 / (EXPONENT + 2.0)) ** 0.25
    view = nodes.add("NewGeometry")
    facing = nodes.vector("DOT_PRODUCT", view.out("Normal"), view.out("Incoming"))
    strength = nodes.maths("MULTIPLY", nodes.attribute("shine", "Fac"), facing)
    nodes.link(strength, shining.node.inputs["Color"])
    both = nodes.add_shaders(nodes.add_shaders(matt, glow), shining)
    nodes.link(both.out(0), nodes.add("OutputMaterial").node.inputs["Surface"])
    return material


def _albedo(nodes: _Nodes, path: str, size: Any) -> Any:
    """Tint times the texture at the place that repeats and quarter turns say."""
    # A file, not pixels in memory: Cycles tells those apart by their address alone, and takes a new picture at the
    # place of a removed one for the old one.
    image = bpy.data.images.load(path)
    image.colorspace_settings.name = "Non-Color"
    width, height = size
    place = nodes.vector("ADD", nodes.add("UVMap").out(0), (0.0, 0.0, 1.0))
    u, v = (
        nodes.maths("FRACT", nodes.vector("DOT_PRODUCT", place, nodes.attribute(row, "Vector")), 0.0)
        for row in ("u_row", "v_row")
    )
    texel = nodes.vector("SCALE", nodes.add("CombineXYZ", X=u, Y=v).out(0), EDGE)
    texel = nodes.vector("ADD", texel, nodes.attribute("tile", "Vector"))
    picture = nodes.add("TexImage", Vector=nodes.vector("DIVIDE", texel, (width, height, 1.0)))
    picture.node.image, picture.node.interpolation, picture.node.extension = image, "Linear", "EXTEND"
    return nodes.vector("MULTIPLY", picture.out("Color"), nodes.attribute("tint", "Vector"))


def _set_sky(world: Any, colours: Any) -> None:
    """Horizon to zenith by the height of the ray (y is down); seen by the camera, no source of light."""
    world.use_nodes = True
    world.node_tree.nodes.clear()
    nodes = _Nodes(world.node_tree)
    world.cycles.sampling_method = "NONE"
    height = nodes.vector("DOT_PRODUCT", nodes.add("TexCoord").out("Generated"), (0.0, -1.0, 0.0))
    share = nodes.maths("MAXIMUM", height, 0.0)
    up = nodes.add("CombineXYZ", X=share, Y=share, Z=share).out(0)
    blend = nodes.vector("MULTIPLY", up, (colours[1] - colours[0]).tolist())
    colour = nodes.vector("ADD", blend, colours[0].tolist())
    background = nodes.add("Background", Color=colour, Strength=nodes.add("LightPath").out("Is Camera Ray"))
    nodes.link(background.out(0), nodes.add("OutputWorld").node.inputs["Surface"])


def _matrix(pose: Any) -> Any:
    """Blender's 4x4 of a pose [3, 4]."""
    return Matrix([*pose.tolist(), [0.0, 0.0, 0.0, 1.0]])


class _Node:
    """A shader node and its outputs."""

    def __init__(self, node: Any) -> None:
        self.node = node

    def out(self, name: str | int) -> Any:
        return self.node.outputs[name]


class _Nodes:
    """A node tree that is written like a sum."""

    def __init__(self, tree: Any) -> None:
        self._tree = tree
        tree.nodes.clear()

    def add(self, kind: str, **inputs: Any) -> _Node:
        node = self._tree.nodes.new(f"ShaderNode{kind}")
        for name, value in inputs.items():
            self.link(value, node.inputs[name])
        return _Node(node)

    def link(self, value: Any, target: Any) -> None:
        """An output of another node, or a number."""
        if hasattr(value, "is_linked"):
            self._tree.links.new(value, target)
        else:
            target.default_value = value

    def vector(self, operation: str, first: Any, second: Any) -> Any:
        node = self._tree.nodes.new("ShaderNodeVectorMath")
        node.operation = operation
        self.link(first, node.inputs[0])
        self.link(second, node.inputs["Scale"] if operation == "SCALE" else node.inputs[1])
        return node.outputs["Value" if operation == "DOT_PRODUCT" else "Vector"]

    def maths(self, operation: str, first: Any, second: Any) -> Any:
        node = self._tree.nodes.new("ShaderNodeMath")
        node.operation = operation
        self.link(first, node.inputs[0])
        self.link(second, node.inputs[1])
        return node.outputs[0]

    def attribute(self, name: str, output: str) -> Any:
        """What the object that is shaded says of itself."""
        node = self._tree.nodes.new("ShaderNodeAttribute")
        node.attribute_type, node.attribute_name = "OBJECT", name
        return node.outputs[output]

    def add_shaders(self, first: _Node, second: _Node) -> _Node:
        node = self._tree.nodes.new("ShaderNodeAddShader")
        self._tree.links.new(first.out(0), node.inputs[0])
        self._tree.links.new(second.out(0), node.inputs[1])
        return _Node(node)


if __name__ == "__main__":
    main()
