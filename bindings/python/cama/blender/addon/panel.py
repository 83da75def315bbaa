# SPDX-License-Identifier: Apache-2.0
"""Cloth simulation by cama in Blender 4.2 or later: a panel in the sidebar of the 3D viewport.

The active mesh, with the modifiers above the one named "cama", its pins and its colliders are sampled over the frames
and given to a process of the Python that has cama; Blender goes on meanwhile. A Mesh Cache modifier plays what the
process writes.
"""

import time

import bpy
from bpy.app.handlers import persistent

from .running import PYTHON, Run, remove
from .sampling import Problem

bl_info = {
    "name": "cama cloth",
    "author": "cama developers",
    "version": (0, 1, 0),
    "blender": (4, 2, 0),
    "location": "3D Viewport > Sidebar > cama",
    "description": "Simulates the active mesh as cloth that does not pass through anything",
    "category": "Physics",
}
FABRICS = ("cotton", "denim", "jersey", "leather", "linen", "polyester", "silk", "wool")
LEVELS = {
    "preview": "Quick and coarse in time, for layout",
    "interactive": "For trying out",
    "production": "For films",
    "accurate": "Small steps",
    "reference": "Very small steps, to judge the others by",
}
STARTS = {
    "reject": "Refuse a start in which the cloth intersects something",
    "untangle": "Move the cloth until it does not",
    "exempt": "Simulate it as it is",
}
PINCHES = {
    "stop": "Stop where colliders or pins pinch the cloth with no way out",
    "release": "Let the cloth pass through the collider there",
}
RESTS = {
    "start": "The mesh as it is at the first frame",
    "uv": "The active UV map, as a pattern",
}
RELATIVE = {"PATH_SUPPORTS_BLEND_RELATIVE"} if bpy.app.version >= (5, 0, 0) else set()  # paths that begin with //


def items(table):
    """Returns the items of an EnumProperty."""
    return [(name, "UV Map" if name == "uv" else name.capitalize(), about) for name, about in table.items()]


class CamaSettings(bpy.types.PropertyGroup):
    """How an object is simulated."""

    fabric: bpy.props.EnumProperty(
        name="Fabric", items=items(dict.fromkeys(FABRICS, "")), default="cotton", description="A fabric of cama"
    )
    fabric_file: bpy.props.StringProperty(
        name="Fabric File", subtype="FILE_PATH", options=RELATIVE,
        description="A material of cama (JSON), in place of Fabric",
    )  # fmt: skip
    level: bpy.props.EnumProperty(
        name="Level", items=items(LEVELS), default="production", description="Accuracy level: time step, solver and all"
    )
    frames: bpy.props.IntProperty(
        name="Frames", default=100, min=1, max=100_000, description="Frames after the scene's first one"
    )
    self_contact: bpy.props.BoolProperty(
        name="Self Contact", default=True, description="Whether the cloth collides with itself"
    )
    pins: bpy.props.StringProperty(
        name="Pins", description="Vertex group: vertices of weight 0.5 or more stay where the modifiers put them"
    )
    colliders: bpy.props.PointerProperty(
        name="Colliders", type=bpy.types.Collection, description="What the cloth collides with, moving or not"
    )
    friction: bpy.props.FloatProperty(
        name="Friction", default=0.3, min=0, max=10, description="Coulomb coefficient of the colliders"
    )
    thickness: bpy.props.FloatProperty(
        name="Thickness", default=0, min=0, max=1, precision=4, step=0.1,
        description="Contact thickness in m; 0: the fabric's, and a millimetre of the colliders",
    )  # fmt: skip
    rest: bpy.props.EnumProperty(
        name="Rest", items=items(RESTS), default="start", description="The shape in which the cloth is unstrained"
    )
    uv_size: bpy.props.FloatProperty(
        name="UV Size", default=1, min=1e-6, description="Length of a unit of the UV map, in units of the scene"
    )
    intersections: bpy.props.EnumProperty(
        name="Intersections", items=items(STARTS), default="reject", description="What to do at the start"
    )
    pinch: bpy.props.EnumProperty(name="Pinch", items=items(PINCHES), default="stop", description="What to do then")
    folder: bpy.props.StringProperty(
        name="Folder", subtype="DIR_PATH", options=RELATIVE,
        description="Where the cache lies, one folder for each object; empty: beside the saved .blend file",
    )  # fmt: skip


class CamaPreferences(bpy.types.AddonPreferences):
    """Where cama is."""

    bl_idname = __package__
    python: bpy.props.StringProperty(
        name="Python with cama", subtype="FILE_PATH", default=PYTHON,
        description="The interpreter of the environment in which `pip install` has put cama",
    )  # fmt: skip

    def draw(self, context):
        self.layout.prop(self, "python")


class CAMA_OT_simulate(bpy.types.Operator):
    """Simulate the active mesh as cloth; what it shows goes on while Blender can be used"""

    bl_idname = "cama.simulate"
    bl_label = "Simulate"

    @classmethod
    def poll(cls, context):
        item = context.active_object
        if item is None or item.type != "MESH":
            cls.poll_message_set("the active object is no mesh")
        elif item.mode != "OBJECT":
            cls.poll_message_set("leave the mode in which the mesh is edited")
        elif Run.current is not None:
            cls.poll_message_set(f"{Run.current.name} is being simulated")
        else:
            return True
        return False

    def execute(self, context):
        """Simulates to the end, for scripts."""
        if not self._begin(context):
            return {"CANCELLED"}
        while self._run.advance():
            time.sleep(0.02)
        return self._finish()

    def invoke(self, context, event):
        """Simulates while the window goes on."""
        if not self._begin(context):
            return {"CANCELLED"}
        self._timer = context.window_manager.event_timer_add(0.1, window=context.window)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        more = self._run.advance()
        for window in context.window_manager.windows:
            for area in window.screen.areas:
                if area.type == "VIEW_3D":
                    area.tag_redraw()
        if more:
            return {"PASS_THROUGH"}
        context.window_manager.event_timer_remove(self._timer)
        return self._finish()

    def _begin(self, context):
        try:
            self._run = Run(context.active_object)
        except Problem as problem:
            self.report({"ERROR"}, str(problem))
            return False
        return True

    def _finish(self):
        run = self._run
        for text in run.warnings:
            self.report({"WARNING"}, text)
        if run.problem:
            self.report({"ERROR"}, run.problem)
        elif run.cancelled:
            self.report({"INFO"}, f"stopped after {run.frames} frames")
        else:
            self.report({"INFO"}, f"{run.frames} frames, {run.intersections} intersections at the end: {run.folder}")
        return {"CANCELLED"} if run.problem or run.cancelled else {"FINISHED"}


class CAMA_OT_cancel(bpy.types.Operator):
    """Stop the simulation; the frames that are there stay"""

    bl_idname = "cama.cancel"
    bl_label = "Cancel"

    @classmethod
    def poll(cls, context):
        return Run.current is not None

    def execute(self, context):
        Run.current.cancelled = True
        return {"FINISHED"}


class CAMA_OT_remove(bpy.types.Operator):
    """Remove the modifier and the files of the active object's simulation"""

    bl_idname = "cama.remove"
    bl_label = "Remove Simulation"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        item = context.active_object
        return item is not None and item.type == "MESH" and Run.current is None

    def execute(self, context):
        try:
            remove(context.active_object)
        except Problem as problem:
            self.report({"ERROR"}, str(problem))
            return {"CANCELLED"}
        return {"FINISHED"}


class CAMA_PT_panel(bpy.types.Panel):
    """The panel of the active mesh"""

    bl_label = "Cloth"
    bl_space_type, bl_region_type, bl_category = "VIEW_3D", "UI", "cama"

    @classmethod
    def poll(cls, context):
        return context.active_object is not None and context.active_object.type == "MESH"

    def draw(self, context):
        layout, item = self.layout, context.active_object
        layout.use_property_split = True
        own = item.cama
        for name in ("fabric", "level", "frames", "self_contact"):
            layout.prop(own, name)
        layout.prop_search(own, "pins", item, "vertex_groups")
        layout.prop(own, "colliders")
        row = layout.row()
        row.scale_y = 1.5
        if Run.current is None:
            row.operator_context = "INVOKE_DEFAULT"
            row.operator("cama.simulate")
            layout.operator("cama.remove")
        else:
            row.progress(factor=Run.current.part, text=Run.current.text)
            layout.operator("cama.cancel")


class CAMA_PT_more(bpy.types.Panel):
    """What is rarely changed"""

    bl_label = "More"
    bl_parent_id = "CAMA_PT_panel"
    bl_space_type, bl_region_type, bl_category = "VIEW_3D", "UI", "cama"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        layout, own = self.layout, context.active_object.cama
        layout.use_property_split = True
        for name in ("fabric_file", "friction", "thickness", "rest", "uv_size", "intersections", "pinch", "folder"):
            row = layout.row()
            row.active = name != "uv_size" or own.rest == "uv"
            row.prop(own, name)


@persistent
def stop(*_):
    """Ends a simulation whose file is left."""
    if Run.current is not None:
        Run.current.stop()
        Run.current = None


CLASSES = (
    CamaSettings,
    CamaPreferences,
    CAMA_OT_simulate,
    CAMA_OT_cancel,
    CAMA_OT_remove,
    CAMA_PT_panel,
    CAMA_PT_more,
)


def register():
    for each in CLASSES:
        bpy.utils.register_class(each)
    bpy.types.Object.cama = bpy.props.PointerProperty(type=CamaSettings)
    bpy.app.handlers.load_pre.append(stop)


def unregister():
    stop()
    bpy.app.handlers.load_pre.remove(stop)
    del bpy.types.Object.cama
    for each in reversed(CLASSES):
        bpy.utils.unregister_class(each)
