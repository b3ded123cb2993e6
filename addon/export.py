# SPDX-License-Identifier: GPL-3.0-or-later
"""The only reader of Blender's scene: evaluated objects in, plain numpy arrays out.

What counts is what the viewport shows, with modifiers and instances, less everything that is switched off for renders.
Objects that the viewport hides are not evaluated by Blender: they are left out with a warning.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from fmm_core import Error, Light, Opacity, Sky, Volume

from . import lights, ray_flags
from .materials import Name, find, name_of
from .meshes import Layers, Mesh, World, about, is_closed, read_mesh, same_topology, with_area
from .node_readers import asked
from .ray_flags import Seen
from .remarks import listed, of_shine
from .sampling import Painted, Painter, Slots, paint
from .scene_arrays import Dark, Receiver, SceneArrays
from .shapes import Shape, two_sided
from .tables import Tables
from .view_layers import hidden, renderable, unhidden
from .volumes import read_volume, volume_of
from .world import read_world

if TYPE_CHECKING:
    import bpy

#: Parts of triangles whose colour varies are this many times smaller than the scene.
DETAIL = 32

#: What a renderer would show besides.
_LEFT_OUT = {"VOLUME": "a volume", "CURVES": "hair", "POINTCLOUD": "points"}

# Stands for names in a remark; no name in Blender holds it.
_OBJECTS = "\0"


def read(context: bpy.types.Context, scope: str, view: bool = False) -> Reading:
    """Read the scene of a context but for its materials: "VISIBLE" as `read_scene` does; "SELECTED" the same, and only
    selected objects get colours; "SCENE" also what the viewport hides. view as in `read_scene`. Raises fmm_core.Error
    as it.
    """
    if scope == "SCENE":
        with unhidden(context.view_layer):
            return read_meshes(context.evaluated_depsgraph_get(), view=view)
    chosen = {obj.name for obj in context.view_layer.objects if obj.select_get()} if scope == "SELECTED" else None
    return read_meshes(context.evaluated_depsgraph_get(), chosen, view)


def count_vertices(layer: bpy.types.ViewLayer, scope: str) -> tuple[int, int]:
    """How many vertices the meshes of a view layer have without their modifiers that a bake of this scope takes, and
    how many of them get colours.
    """
    meshes = [obj for obj in layer.objects if obj.type == "MESH" and not obj.hide_render]
    if scope == "SCENE":
        shown = set(renderable(layer.layer_collection))
        meshes = [obj for obj in meshes if obj.name in shown]
    else:
        meshes = [obj for obj in meshes if obj.visible_get()]
    every = sum(len(obj.data.vertices) for obj in meshes)
    if scope != "SELECTED":
        return every, every
    return every, sum(len(obj.data.vertices) for obj in meshes if obj.select_get())


def read_scene(depsgraph: bpy.types.Depsgraph, chosen: set[str] | None = None, view: bool = False) -> Reading:
    """Read every mesh that a render would show; only the chosen objects, or all, get colours.

    view: also where the active camera is, and the gloss that it sees.
    Raises fmm_core.Error naming object and value where a vertex is not finite, or where a view has no camera.
    """
    reading = read_meshes(depsgraph, chosen, view)
    for _ in reading.painting():
        pass
    return reading


def read_meshes(depsgraph: bpy.types.Depsgraph, chosen: set[str] | None = None, view: bool = False) -> Reading:
    """The same without materials, for which `painting` is left to do."""
    reading = Reading(depsgraph, chosen, _eye(depsgraph) if view else None)
    # Real objects first: a mesh that is also instanced is then baked where its own object stands.
    for of_instances in (False, True):
        for instance in reading.shown(of_instances):
            reading.take(instance)
    reading.close()
    return reading


@dataclass
class Reading:
    """A scene as it was read, object after object.

    receivers: the meshes that get colours; unpainted: what reads the materials of a mesh, step by step; later: what
    puts the parts together, which needs no Blender
    """

    depsgraph: bpy.types.Depsgraph
    chosen: set[str] | None
    eye: np.ndarray | None
    parts: dict[str, list[np.ndarray]] = field(default_factory=dict)
    receivers: list[Receiver] = field(default_factory=list)
    users: dict[str, list[str]] = field(default_factory=dict)
    remarks: dict[str, list[str]] = field(default_factory=dict)
    cells: dict[str, list[np.ndarray | None]] = field(default_factory=lambda: {"opacity": [], "shade": []})
    shaded: bool = False
    shapes: list[Shape] = field(default_factory=list)
    lights: list[Light] = field(default_factory=list)
    volumes: list[Volume] = field(default_factory=list)
    meshes: int = 0
    corner_count: int = 0
    vertex_count: int = 0
    unpainted: list[Iterator[None]] = field(default_factory=list)
    later: list[Callable[[], None]] = field(default_factory=list)
    scene: str = ""
    sky: Sky | None = None

    def __post_init__(self) -> None:
        self.painter = Painter(_size(self.depsgraph) / DETAIL, {}, {}, Tables(), self.eye is not None)
        self.renderable = set(renderable(self.depsgraph.view_layer_eval.layer_collection))
        # Where a collection is hidden, Blender evaluates its objects all the same.
        visible = {obj.name for obj in self.depsgraph.view_layer.objects if obj.visible_get()}
        self.taken = self.renderable & visible

    def shown(self, of_instances: bool) -> Iterator[bpy.types.DepsgraphObjectInstance]:
        """The instances that a render would show: the real objects, or the copies."""
        for instance in self.depsgraph.object_instances:
            if instance.is_instance != of_instances or not instance.show_self:
                continue
            holder = instance.parent if instance.is_instance else instance.object
            hidden = instance.object.hide_render or holder.hide_render
            hidden |= holder.original.name not in self.taken
            replaced = holder.original.is_instancer and not holder.show_instancer_for_render and not of_instances
            if not hidden and not replaced:
                yield instance

    def take(self, instance: bpy.types.DepsgraphObjectInstance) -> None:
        """Add one object or copy to the scene."""
        obj = instance.object
        if obj.type == "LIGHT":
            self.take_light(obj, np.array(instance.matrix_world, np.float64))
        if obj.type == "META":
            # The first ball of a family has the faces of all.
            data = obj.to_mesh()
            if data is not None and len(data.polygons):
                self.add(instance, data)
            obj.to_mesh_clear()
        elif obj.type in _LEFT_OUT:
            self.remark(f"object '{obj.name}' ({_LEFT_OUT[obj.type]}) is not simulated: left out")
        elif obj.type == "MESH" and len(obj.data.polygons):
            self.add(instance, obj.data)
        elif obj.type == "MESH":
            self.meshes += 1
            if not (instance.is_instance or obj.modifiers):
                self.remark(f"object '{obj.name}' has no faces: left out")

    def add(self, instance: bpy.types.DepsgraphObjectInstance, data: bpy.types.Mesh) -> None:
        """Add the faces of one object or copy: its mesh now, its materials step by step, all else later."""
        self.meshes += 1
        obj, mesh = instance.object, read_mesh(data)
        seen = ray_flags.of(instance)
        for text in ray_flags.remarks(obj, seen, self.eye is not None):
            self.remark(f"object '{obj.name}' {text}")
        world = World(obj.name, mesh, np.array(instance.matrix_world, np.float64))
        materials = _materials(obj)
        named = asked(materials)
        layers = Layers(data, mesh, world, about(instance), named)
        slots = Slots(mesh, layers, world.mirrored, len(materials))
        reads = ("", True) in named.attributes
        offsets = self.add_receiver(instance, mesh, reads) if self.is_receiver(instance, mesh) else None
        self.unpainted.append(self.paint(obj.name, world, slots, list(map(name_of, materials)), seen, offsets))

    def painting(self) -> Iterator[None]:
        """Read the materials of all meshes, in steps between which Blender may do what it likes.

        Raises fmm_core.Error naming what cannot be read, or is gone by then.
        """
        while self.unpainted:
            yield from self.unpainted.pop(0)

    def paint(
        self, name: str, world: World, slots: Slots, materials: list[Name | None], seen: Seen, offsets: tuple | None
    ) -> Iterator[None]:
        """Read the materials of one object or copy; offsets: its first corner and vertex, if it gets colours."""
        mesh = slots.mesh
        coats, remarks = yield from self.painter.coats(slots, materials)
        absorption = []
        for material in (materials[coat.slot] for coat in coats):
            absorbs, left_out = read_volume(find(material))
            absorption.append(absorbs)
            remarks += [(material, text) for text in left_out]
        for material, text in remarks:
            self.remark(f"material '{material[0]}' on object {_OBJECTS}: {text}", name)

        def finish() -> None:
            painted = paint(slots, coats, self.eye is not None)
            if any(seen):
                self.add_faces(name, mesh, world, painted, seen)
                self.add_volume(name, mesh, painted, absorption)
            if offsets is not None:
                self.add_corners(mesh, world, painted, *offsets)

        self.later.append(finish)

    def take_light(self, obj: bpy.types.Object, matrix: np.ndarray) -> None:
        """Add one lamp, or a copy of one, where its matrix (4,4) puts it."""
        light, remarks = lights.read_light(obj, matrix)
        if light is not None:
            self.lights.append(light)
        for text in remarks:
            self.remark(f"light '{obj.name}' {text}")

    def add_faces(self, name: str, mesh: Mesh, world: World, painted: Painted, seen: Seen) -> None:
        """Add everything that blocks, reflects or gives off light; triangles without area do none of it."""
        kept = with_area(world.position[mesh.corner_vertex[mesh.triangle_corners]])
        flat = len(mesh.face_corners) - len(np.unique(mesh.triangle_face[kept]))
        if flat:
            faces = "1 face" if flat == 1 else f"{flat} faces"
            self.remark(f"object '{name}': {faces} without area left out")
        names = "triangles", "albedo", "emission", "one_sided", "shiny"
        self.append(**{name: getattr(painted, name) for name in names})
        for rays, meets in zip(("opacity", "shade"), seen, strict=True):
            self.append(**{rays: painted.opacity * meets})
            self.cells[rays] += painted.opacity_cells if meets else [None] * len(painted.opacity)
        self.shaded |= seen.diffuse != seen.shadow
        self.shapes.append(Shape(mesh, world.position, world.mirrored, len(painted.triangles)))

    def add_volume(self, name: str, mesh: Mesh, painted: Painted, absorption: list[np.ndarray]) -> None:
        """Add what is inside an object, whose materials absorb so much, if light gets there."""
        if not np.any(absorption) or painted.opacity.min(initial=1.0) == 1.0:
            return
        if (np.ptp(absorption, axis=0) > 0).any():
            self.remark(f"object '{name}': its materials have several volumes, which are left out")
            return
        try:
            self.volumes.append(volume_of(name, painted.triangles, absorption[0], is_closed(mesh)))
        except Error as error:
            self.remark(str(error))

    def is_receiver(self, instance: bpy.types.DepsgraphObjectInstance, mesh: Mesh) -> bool:
        """Whether the mesh of this object can take colours and has not been taken yet; says why not."""
        obj, original = instance.object, instance.object.original
        if self.chosen is not None and original.name not in self.chosen:
            return False
        made_by_itself = instance.is_instance and instance.parent.original == original
        if original.type != "MESH":
            self.remark(f"object '{obj.name}' ({original.type}) blocks and reflects light but gets no colours: "
                        "convert it to a mesh to bake onto it")  # fmt: skip
        elif made_by_itself or not same_topology(mesh, original.data):
            names = " and ".join(f"'{modifier.name}'" for modifier in obj.modifiers if modifier.show_viewport)
            self.remark(f"object '{obj.name}': modifier {names} changes the mesh, which gets no colours: "
                        "apply it to bake onto it")  # fmt: skip
        elif not original.data.is_editable:
            self.remark(f"mesh '{original.data.name}' of object '{obj.name}' is linked from a library and gets no "
                        "colours: make it local to bake onto it")  # fmt: skip
        else:
            users = self.users.setdefault(original.data.name, [])
            users.append(instance.parent.name if instance.is_instance else obj.name)
            return len(users) == 1
        return False

    def add_receiver(self, instance: bpy.types.DepsgraphObjectInstance, mesh: Mesh, reads: bool) -> tuple[int, int]:
        """Let a mesh get colours; returns the numbers of its first corner and of its first vertex."""
        obj, corners, vertices = instance.object, self.corner_count, self.vertex_count
        self.corner_count += len(mesh.corner_vertex)
        self.vertex_count += len(mesh.vertex)
        rows = slice(corners, self.corner_count)
        shape = mesh.corner_vertex, len(mesh.vertex), mesh.smooth
        self.receivers.append(Receiver(obj.original.data.name, obj.name, rows, *shape, reads))
        return corners, vertices

    def add_corners(self, mesh: Mesh, world: World, painted: Painted, corners: int, vertices: int) -> None:
        """Everything that is needed to colour a mesh whose corners and vertices count from these."""
        self.append(
            corner_position=world.position[mesh.corner_vertex],
            corner_normal=world.corner_normal,
            corner_vertex=mesh.corner_vertex + vertices,
            corner_albedo=painted.corner_albedo,
            corner_emission=painted.corner_emission,
            corner_gloss=painted.corner_gloss,
            corner_triangles=mesh.triangle_corners + corners,
        )

    def append(self, **arrays: np.ndarray) -> None:
        """Add rows to the named arrays."""
        for name, rows in arrays.items():
            self.parts.setdefault(name, []).append(rows)

    def remark(self, text: str, obj: str | None = None) -> None:
        """Keep a warning; the objects that share one are named together in place of _OBJECTS."""
        objects = self.remarks.setdefault(text, [])
        if obj is not None and obj not in objects:
            objects.append(obj)

    def close(self) -> None:
        """Read what belongs to no object; after this Blender is asked for materials alone, by `painting`."""
        scene = self.depsgraph.scene
        self.scene = scene.name
        self.add_scene_remarks()
        self.sky, remarks = read_world(scene)
        self.medium, more = read_volume(scene.world)
        for text in (*remarks, *more):
            self.remark(f"world '{scene.world.name}': {text}")

    def arrays(self) -> SceneArrays:
        """Put the parts together, in any thread.

        Raises fmm_core.Error where there is no mesh, no face, or no mesh that can take colours, and Dark where there
        is no emitter.
        """
        while self.later:
            self.later.pop(0)()
        scene, sky = self.scene, self.sky
        warnings = tuple(text.replace(_OBJECTS, listed(names)) for text, names in self.remarks.items())
        because = f" ({'; '.join(warnings)})" if warnings else ""
        if not self.meshes:
            raise Error(f"scene '{scene}' has no mesh that a render would show{because}")
        if not sum(len(part) for part in self.parts.get("triangles", [])):
            raise Error(f"no mesh of scene '{scene}' has a face that light meets{because}")
        if not self.receivers and self.chosen is not None:
            raise Error(f"nothing that can take colours is selected: select the meshes to bake onto{because}")
        if not self.receivers:
            raise Error(f"no mesh of scene '{scene}' can take colours{because}")
        arrays = {name: np.concatenate(parts) for name, parts in self.parts.items()}
        if not arrays["emission"].any() and not self.lights and sky is None:
            raise Dark(f"nothing in scene '{scene}' gives off light: add a lamp, give a mesh a material with an "
                       f"Emission shader, or the world a colour{because}", warnings)  # fmt: skip
        names = [name[0] for name in self.painter.shiny]
        warnings += of_shine(names, arrays.pop("shiny"), arrays["triangles"], arrays["albedo"])
        arrays["two_sided"] = two_sided(self.shapes) & ~arrays.pop("one_sided")
        for rays, cells in self.cells.items():
            arrays[rays] = _opacity(arrays[rays], cells)
        if not arrays["opacity"].mean.any():
            raise Error(f"no mesh of scene '{scene}' has a face that stops light of surfaces{because}")
        if not self.shaded:
            del arrays["shade"]
        return SceneArrays(
            **arrays, lights=tuple(self.lights), sky=sky, medium=self.medium, volumes=tuple(self.volumes),
            receivers=tuple(self.receivers), warnings=warnings, eye=self.eye, tables=tuple(self.painter.tables.found),
        )  # fmt: skip

    def add_scene_remarks(self) -> None:
        """Warnings that belong to no single object that was read."""
        for mesh, users in self.users.items():
            names = list(dict.fromkeys(users))
            if len(names) > 1:
                self.remark(f"mesh '{mesh}' is shared by {listed(names)}: its colours are those of '{names[0]}'")
            elif len(users) > 1:
                self.remark(f"mesh '{mesh}' appears {len(users)} times in '{names[0]}': its colours are those of the "
                            "first")  # fmt: skip
        for obj in hidden(self.depsgraph.view_layer, self.renderable):
            left_out = "is hidden in the viewport: left out"
            self.remark(f"light '{obj.name}' {left_out}" if obj.type == "LIGHT" else f"object '{obj.name}' {left_out}")


def _opacity(values: np.ndarray, cells: list[np.ndarray | None]) -> Opacity:
    varying = {row: grid for row, grid in enumerate(cells) if grid is not None}
    # A list of so many numbers would become an array under the interpreter's lock.
    steps, grids = np.zeros(len(cells), np.int64), list(varying.values())
    steps[list(varying)] = [round(len(grid) ** 0.5) for grid in grids]
    return Opacity(np.clip(values, 0, 1), steps, np.concatenate(grids) if grids else ())


def _eye(depsgraph: bpy.types.Depsgraph) -> np.ndarray:
    """(4,) where the active camera is, m, or in which direction it is if its rays are parallel, homogeneous."""
    camera = depsgraph.scene.camera
    if camera is None or camera.type != "CAMERA":
        raise Error(f"scene '{depsgraph.scene.name}' has no camera that could see the gloss: add one, or leave the "
                    "view out")  # fmt: skip
    matrix = np.array(camera.evaluated_get(depsgraph).matrix_world, np.float64)
    return matrix[:, 2] if camera.data.type == "ORTHO" else matrix[:, 3]


def _size(depsgraph: bpy.types.Depsgraph) -> float:
    """About how large a scene is, m: the longest side of a box around its meshes."""
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for instance in depsgraph.object_instances:
        if instance.object.type in ("MESH", "META"):
            corners = np.array(instance.object.bound_box, float) @ np.array(instance.matrix_world, float)[:3, :3].T
            corners += np.array(instance.matrix_world, float)[:3, 3]
            low, high = np.minimum(low, corners.min(axis=0)), np.maximum(high, corners.max(axis=0))
    size = (high - low).max()
    return float(size) if np.isfinite(size) and size > 0 else 1.0


def _materials(obj: bpy.types.Object) -> list[bpy.types.Material | None]:
    """The material of every slot, those set on the object itself first; one None where there is no slot."""
    found = list(obj.data.materials)
    for index, slot in enumerate(obj.material_slots):
        if index < len(found) and slot.link == "OBJECT":
            found[index] = slot.material
    return found or [None]
