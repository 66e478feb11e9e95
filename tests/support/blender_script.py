"""What the add-on's tests do in Blender; run by it, or by the Python that has the wheel `bpy`."""

import json
import sys
import tempfile
import time
from pathlib import Path

import bpy

archive, program, folder, what = sys.argv[-4:]


def compositing(scene):
    """Run the operator of the panel; what it tells."""
    settings = scene.nlens
    settings.preset, settings.fit = "draft", folder + "/fit.json"
    settings.result, settings.words = folder + "/out.mp4", "--track-focus off"
    if what == "spaces":
        settings.fit, settings.words = "", f"--fit '{folder}/a lens/fit.json' --track-focus off"
    elif what in ("--no-such-option", "--fit 'a lens"):
        settings.words = what
    told = {}
    try:
        told["result"] = sorted(bpy.ops.nlens.composite())
    except RuntimeError as error:
        told["error"] = str(error)
    told["selected"] = sorted(one.type for one in scene.objects if one.select_get())
    told["images"] = [one.name for one in bpy.data.images]
    editor = scene.sequence_editor
    strips = getattr(editor, "strips", None) or getattr(editor, "sequences", ())
    told["strips"] = [[one.name, one.frame_final_duration] for one in strips]
    told["size"] = [scene.render.resolution_x, scene.render.resolution_y]
    return told


def exporting(scene):
    """Composite, and export the same objects into a file that stays."""
    from nlens_video_blender import plate

    told = compositing(scene)
    plate.export(bpy.context, plate.of_scene(scene), Path(folder, "exported.glb"))
    told["temporary"] = [one.name for one in Path(folder).glob("nlens-blender-*")]
    return told


def kept_action(scene):
    """Composite an object whose active action stays, beside one in the NLA that moves it away."""
    moved = next(one for one in scene.objects if one.type == "MESH")
    moved.animation_data_clear()
    here = moved.location.copy()

    def action(name, x):
        moved.location.x = x
        moved.keyframe_insert("location", frame=0)
        made, moved.animation_data.action = moved.animation_data.action, None
        made.name = name
        return made

    track = action("kept", here.x + 0.3), action("shown", here.x)
    strip = moved.animation_data.nla_tracks.new()
    strip.strips.new("kept", 0, track[0])
    strip.mute = True
    moved.animation_data.action = track[1]
    if hasattr(moved.animation_data, "action_slot"):  # from 4.4 on
        moved.animation_data.action_slot = track[1].slots[0]
    unlit = bpy.data.collections.new("off")
    scene.collection.children.link(unlit)
    unlit.objects.link(bpy.data.objects.new("lamp", bpy.data.lights.new("lamp", "SUN")))
    bpy.context.view_layer.layer_collection.children["off"].exclude = True
    return compositing(scene)


def numbered(scene):
    """Composite into numbered pictures, in a scene of another rate than 24."""
    scene.active_clip = bpy.data.movieclips.load(folder + "/numbered/in.0001.png")
    return compositing(scene)


def saving(scene):
    """Save the scene while a run goes on, end that, and open the scene again."""
    from nlens_video_blender import NLENS_OT_composite
    from nlens_video_blender.job import Job

    words = (program, folder + "/in.mp4", Path(folder, "anim.glb"), Path(folder, "cut.mkv"), [])
    NLENS_OT_composite.latest = job = Job(*words, tempfile.TemporaryDirectory())
    told = {"before": [scene.nlens.running, bpy.ops.nlens.composite.poll()]}
    bpy.ops.wm.save_as_mainfile(filepath=folder + "/scene.blend")
    job.cancel()
    job.wait()
    bpy.ops.wm.open_mainfile(filepath=folder + "/scene.blend")
    told["after"] = [bpy.context.scene.nlens.running, bpy.ops.nlens.composite.poll()]
    told["preset"] = bpy.context.scene.nlens.preset
    return told


def cancelling(scene):
    """Cancel a run half a second after its start."""
    from nlens_video_blender.job import Job

    words = (program, folder + "/in.mp4", Path(folder, "anim.glb"), Path(folder, "cut.mkv"), [])
    job = Job(*words, tempfile.TemporaryDirectory())
    time.sleep(0.5)
    job.cancel()
    job.wait()
    return {"error": job.error, "left": Path(folder, "cut.mkv").exists()}


def layers(scene):
    """Import the layers, and render what each output of the group shows on two frames."""
    from nlens_video_blender.layers import NAME

    assert bpy.ops.nlens.import_layers(filepath=folder + "/aov/000003.exr") == {"FINISHED"}
    tree = getattr(scene, "compositing_node_group", None) or scene.node_tree
    group = next(one for one in tree.nodes if one.bl_idname == "CompositorNodeGroup")
    assert group.node_tree.name == NAME
    (plate,), (shown,) = group.inputs["Plate"].links, group.outputs["Image"].links
    told = {"placed": sorted([shown.from_socket.name, plate.to_socket.name]), "grey": 0.18}
    out = shown.to_socket
    tree.links.remove(plate)
    group.inputs["Plate"].default_value = (0.18, 0.18, 0.18, 1.0)
    scene.render.resolution_x, scene.render.resolution_y = bpy.data.images[0].size[:]
    scene.render.resolution_percentage = 100
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_depth = "32"
    told["rendered"] = {}
    for name in ("Image", "Object", "Object CoC", "Object Depth", "Plate CoC", "Mask"):
        tree.links.new(group.outputs[name], out)
        told["rendered"][name] = {}
        for frame in (0, 7):
            file = f"{name.replace(' ', '-')}-{frame}.exr"
            scene.frame_set(scene.frame_start + frame)
            scene.render.filepath = folder + "/" + file
            bpy.ops.render.render(write_still=True)
            told["rendered"][name][str(frame)] = file
    return told


def without_numpy(scene):
    """Export and import where Blender's Python has no numpy."""
    sys.modules["numpy"] = None
    told = {"export": compositing(scene)["error"]}
    try:
        bpy.ops.nlens.import_camera(filepath=folder + "/anim.glb")
    except RuntimeError as error:
        told["import"] = str(error)
    return told


def refused(scene):
    """Import what holds no layers."""
    chosen = {"no layers": "/anim.glb", "other layers": "/other/000000.exr"}[what]
    try:
        bpy.ops.nlens.import_layers(filepath=folder + chosen)
    except RuntimeError as error:
        return {"error": str(error)}
    return {}


def refused_cameras(scene):
    """Import what holds no camera, or is no glTF; what is said of each."""
    told = {}
    for name in ("missing.glb", "garbage.glb", "damaged.gltf"):
        try:
            bpy.ops.nlens.import_camera(filepath=folder + "/" + name)
        except RuntimeError as error:
            told[name] = str(error)
    return told


bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.preferences.addon_install(filepath=archive)
bpy.ops.preferences.addon_enable(module="nlens_video_blender")
bpy.context.preferences.addons["nlens_video_blender"].preferences.program = program
scene = bpy.context.scene
scene.render.fps, scene.frame_start, scene.frame_end = 25, 0, 11
bpy.ops.nlens.import_camera(filepath=folder + "/anim.glb")
clip = bpy.data.movieclips.load(folder + "/in.mp4")
if what == "background":
    behind = scene.camera.data.background_images.new()
    behind.source, behind.clip = "MOVIE_CLIP", clip
elif what != "no plate":
    scene.active_clip = clip
scene.nlens.preset = "realtime"
for one in scene.objects:
    one.select_set(one.type == "MESH")
doing = {
    "cancel": cancelling, "layers": layers, "no layers": refused, "other layers": refused,
    "no numpy": without_numpy, "bad cameras": refused_cameras, "save": saving,
    "clip": exporting, "background": exporting, "kept action": kept_action, "numbered": numbered,
}  # fmt: skip
print("TOLD" + json.dumps(doing.get(what, compositing)(scene)))
