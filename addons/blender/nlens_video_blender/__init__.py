"""Blender add-on of nlens-video: shoot the selected objects through the plate's lens."""

import tempfile
from pathlib import Path

import bpy
from bpy_extras.io_utils import ImportHelper

from . import job, layers, plate

bl_info = {
    "name": "nlens-video",
    "description": "Puts the selected objects into the plate as if its lens had filmed them",
    "author": "nlens-video",
    "version": (0, 1, 0),
    "blender": (3, 4, 0),
    "location": "3D View > Sidebar > nlens-video",
    "category": "Compositing",
}
_PRESETS = [(name, name, "") for name in ("draft", "realtime", "standard", "paper", "reference")]
_TICK_S = 0.2


class NlensPreferences(bpy.types.AddonPreferences):
    """Where the program is."""

    bl_idname = __name__
    program: bpy.props.StringProperty(
        name="Program",
        subtype="FILE_PATH",
        default="",
        description="nlens-video of the environment where it is installed; empty: that on the PATH",
    )

    def draw(self, context: bpy.types.Context) -> None:
        """The one field."""
        self.layout.prop(self, "program")


def _percent(settings: bpy.types.PropertyGroup) -> int:
    latest = NLENS_OT_composite.latest
    return 0 if latest is None else latest.percent


def _is_running(settings: bpy.types.PropertyGroup) -> bool:
    latest = NLENS_OT_composite.latest
    return latest is not None and not latest.done


class NlensSettings(bpy.types.PropertyGroup):
    """Of a scene; progress is that of this session's run, and is not saved with the scene."""

    preset: bpy.props.EnumProperty(name="Preset", items=_PRESETS, default="standard")
    result: bpy.props.StringProperty(
        name="Result", subtype="FILE_PATH", default="//nlens.mp4", description="Written anew"
    )
    fit: bpy.props.StringProperty(
        name="Lens fit", subtype="FILE_PATH", description="fit.json, where the lens is known"
    )
    words: bpy.props.StringProperty(
        name="Options",
        description="Further options of nlens-video, as on the command line; quote what has spaces",
    )
    progress: bpy.props.IntProperty(
        name="Progress", subtype="PERCENTAGE", min=0, max=100, get=_percent
    )
    running: bpy.props.BoolProperty(get=_is_running)


class NLENS_OT_composite(bpy.types.Operator):
    """Export the selected objects with the camera, and composite them into the plate."""

    bl_idname = "nlens.composite"
    bl_label = "Shoot through the plate's lens"
    latest = None  # run of this session
    _job = None
    _timer = None

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only one run at a time, and something must be selected."""
        return bool(context.selected_objects) and not context.scene.nlens.running

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Run to the end, as scripts do."""
        if not self._start(context):
            return {"CANCELLED"}
        self._job.wait()
        return self._end(context)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Run in the background; Escape cancels."""
        if not self._start(context):
            return {"CANCELLED"}
        manager = context.window_manager
        self._timer = manager.event_timer_add(_TICK_S, window=context.window)
        manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Look at the program now and then."""
        if event.type == "ESC" and event.value == "PRESS":
            self._job.cancel()
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        for area in context.screen.areas:
            area.tag_redraw()
        if not self._job.done:
            return {"RUNNING_MODAL"}
        context.window_manager.event_timer_remove(self._timer)
        return self._end(context)

    def _start(self, context: bpy.types.Context) -> bool:
        scene, settings = context.scene, context.scene.nlens
        try:
            shown = plate.of_scene(scene)
            rate = plate.rate(scene)
            words = ["--preset", settings.preset]
            if (
                shown.numbered
            ):  # pictures tell no rate; one among the options comes later, and holds
                words += ["--input-rate", f"{rate:.9g}"]
            words += job.split_options(settings.words)
            if settings.fit:
                words += ["--fit", bpy.path.abspath(settings.fit)]
            words += ["--animation-offset", f"{scene.frame_start / rate:.9g}"]
            folder = tempfile.TemporaryDirectory(prefix="nlens-blender-")
            glb = plate.export(context, shown, Path(folder.name) / "selected.glb")
            result = Path(bpy.path.abspath(settings.result))
            program = context.preferences.addons[__name__].preferences.program
            self._job = job.Job(program, shown.path, glb, result, words, folder)
        except (OSError, ValueError) as error:
            self.report({"ERROR"}, str(error))
            return False
        NLENS_OT_composite.latest = self._job
        return True

    def _end(self, context: bpy.types.Context) -> set[str]:
        if self._job.cancelled:
            self.report({"WARNING"}, "cancelled; nothing was written")
            return {"CANCELLED"}
        if self._job.error:
            self.report({"ERROR"}, self._job.error)
            return {"CANCELLED"}
        plate.show(context, self._job.result)
        self.report({"INFO"}, f"{self._job.result}")
        return {"FINISHED"}


class NLENS_OT_import_camera(bpy.types.Operator, ImportHelper):
    """Import a camera.glb that `nlens-video solve` wrote, and look through it."""

    bl_idname = "nlens.import_camera"
    bl_label = "Import solved camera"
    filter_glob: bpy.props.StringProperty(default="*.glb;*.gltf", options={"HIDDEN"})

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Import, and make its camera the scene's."""
        before = set(context.scene.objects)
        try:
            plate.import_scene(Path(bpy.path.abspath(self.filepath)))
        except ValueError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        cameras = [one for one in set(context.scene.objects) - before if one.type == "CAMERA"]
        if not cameras:
            self.report({"ERROR"}, f"{self.filepath}: no camera in it")
            return {"CANCELLED"}
        context.scene.camera = cameras[0]
        return {"FINISHED"}


class NLENS_OT_import_layers(bpy.types.Operator, ImportHelper):
    """Put the layers that `--aov` wrote into the compositor, as a node group over the plate."""

    bl_idname = "nlens.import_layers"
    bl_label = "Layers into the compositor"
    filter_glob: bpy.props.StringProperty(default="*.exr", options={"HIDDEN"})

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Make the group of the chosen file's folder, and place it."""
        try:
            group = layers.add_group(context.scene, Path(bpy.path.abspath(self.filepath)))
        except (ValueError, RuntimeError) as error:
            self.report({"ERROR"}, str(error).strip())
            return {"CANCELLED"}
        layers.place(context.scene, group)
        return {"FINISHED"}


class NLENS_PT_panel(bpy.types.Panel):
    """In the sidebar of the 3D view."""

    bl_label = "Shoot through the plate's lens"
    bl_idname = "NLENS_PT_panel"
    bl_space_type, bl_region_type, bl_category = "VIEW_3D", "UI", "nlens-video"

    def draw(self, context: bpy.types.Context) -> None:
        """Plate, settings, and the button or the progress."""
        layout, settings = self.layout, context.scene.nlens
        try:
            layout.label(text=f"Plate: {plate.of_scene(context.scene).path}", icon="FILE_MOVIE")
        except ValueError as error:
            layout.label(text=str(error), icon="ERROR")
        layout.operator(NLENS_OT_import_camera.bl_idname)
        for name in ("preset", "fit", "words", "result"):
            layout.prop(settings, name)
        if settings.running:
            layout.prop(settings, "progress", slider=True)
            layout.label(text="Escape cancels")
        else:
            layout.operator(NLENS_OT_composite.bl_idname, icon="RENDER_ANIMATION")
        layout.operator(NLENS_OT_import_layers.bl_idname)


_CLASSES = (
    NlensPreferences, NlensSettings, NLENS_OT_composite, NLENS_OT_import_camera,
    NLENS_OT_import_layers, NLENS_PT_panel,
)  # fmt: skip


def register() -> None:
    """Called by Blender when the add-on is switched on."""
    for one in _CLASSES:
        bpy.utils.register_class(one)
    bpy.types.Scene.nlens = bpy.props.PointerProperty(type=NlensSettings)


def unregister() -> None:
    """Called by Blender when it is switched off."""
    del bpy.types.Scene.nlens
    for one in reversed(_CLASSES):
        bpy.utils.unregister_class(one)
