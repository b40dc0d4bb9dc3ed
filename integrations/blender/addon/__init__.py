# SPDX-License-Identifier: GPL-3.0-or-later
"""blurmatte in Blender: solve a picture or a clip, and composite its object.

The add-on imports nothing of blurmatte. It runs the command of an environment that the preferences
name, and opens the files that it writes.
"""

from pathlib import Path

import bpy
from bpy.props import (
    BoolProperty,
    CollectionProperty,
    EnumProperty,
    IntProperty,
    PointerProperty,
    StringProperty,
)

from . import results, running, scene

_PLATES = ("plate", "empty", "background", "clean")  # what names of plates contain
_STEP_S = 0.25  # between two looks at the process
_LINE = 48  # letters of a line of the panel


class Preferences(bpy.types.AddonPreferences):
    """Where the command is."""

    bl_idname = __package__

    command: StringProperty(
        name="Command",
        subtype="FILE_PATH",
        description="blurmatte of an environment, as .venv/bin/blurmatte; empty: that of the system",
    )

    def draw(self, _context):
        """Draw the path of the command."""
        self.layout.prop(self, "command")


class Settings(bpy.types.PropertyGroup):
    """What is solved, and what came of it."""

    source: StringProperty(name="Picture or clip", subtype="FILE_PATH")
    plate: StringProperty(
        name="Plate",
        subtype="FILE_PATH",
        description="The same scene without the object; of a clip it is made if none is given",
    )
    folder: StringProperty(
        name="Results",
        subtype="DIR_PATH",
        description="Where they are written; empty: a folder beside the picture",
    )
    first_frame: IntProperty(
        name="First frame",
        default=1,
        description="Frame of the scene that shows frame 0 of the clip",
    )
    background: EnumProperty(
        name="Over",
        items=[
            ("PLATE", "The plate or the clip", "The layer over the picture that it came from"),
            ("SCENE", "What is composited now", "The layer over the result of the compositor"),
        ],
    )
    standard: BoolProperty(
        name="Colors of the picture",
        default=True,
        description="Show light as the picture has it (view transform Standard)",
    )
    said: StringProperty()
    progress: StringProperty()


class _Job:
    """The run of this Blender, and whether it should stop."""

    run = None
    stop = False


def command_of(context):
    """The command of the preferences, or that of the system."""
    addon = context.preferences.addons.get(__package__)
    return running.found_command(bpy.path.abspath(addon.preferences.command) if addon else "")


def folder_of(settings):
    """The folder of the results."""
    if settings.folder:
        return Path(bpy.path.abspath(settings.folder))
    source = Path(bpy.path.abspath(settings.source))
    return source.with_name(f"{source.stem}_blurmatte")


def size_of(folder, image):
    """(width, height) of the picture: as the report says, else of the layer."""
    stated = results.read_json(Path(folder) / "report.json").get("image", {}).get("size")
    return tuple(stated or image.size)


class Solve(bpy.types.Operator):
    """Separate the object from a picture over its plate, or from a clip, and composite it."""

    bl_idname = "blurmatte.solve"
    bl_label = "Solve…"
    bl_options = {"REGISTER"}  # noqa: RUF012

    directory: StringProperty(subtype="DIR_PATH")
    files: CollectionProperty(type=bpy.types.OperatorFileListElement, options={"SKIP_SAVE"})
    choose: BoolProperty(
        default=True, options={"SKIP_SAVE", "HIDDEN"}
    )  # files, not those of the panel

    def invoke(self, context, _event):
        """Ask for the picture and its plate, or for a clip."""
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context):
        """Start the command; without a window wait for it."""
        settings = context.scene.blurmatte
        try:
            self._choose(settings)
            arguments = running.solve_arguments(
                bpy.path.abspath(settings.source),
                settings.plate and bpy.path.abspath(settings.plate),
                folder_of(settings),
            )
            self._command = command_of(context)
            _Job.stop, _Job.run = False, running.Run(self._command, arguments)
        except (OSError, ValueError) as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        if bpy.app.background or context.window is None:
            _Job.run.wait()
            return self._ended(context)
        self._timer = context.window_manager.event_timer_add(_STEP_S, window=context.window)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def _choose(self, settings):
        """Take the chosen files for picture and plate."""
        listed = [str(Path(self.directory) / one.name) for one in self.files if one.name]
        chosen = listed if self.choose else []
        if len(chosen) == 1:
            settings.source, settings.plate = chosen[0], ""
        elif len(chosen) == 2:
            plates = [
                one for one in chosen if any(word in Path(one).stem.lower() for word in _PLATES)
            ]
            if len(plates) != 1:
                raise ValueError(
                    "which of them is the plate? Give it in the panel, or call it plate"
                )
            settings.plate = plates[0]
            settings.source = next(one for one in chosen if one != plates[0])
        elif chosen:
            raise ValueError("choose a picture and its plate, or one clip")
        if not settings.source:
            raise ValueError("choose a picture and its plate, or a clip")

    def modal(self, context, event):
        """Show the stage; Escape stops it."""
        if event.type == "ESC":
            _Job.stop = True
        if event.type != "TIMER" and not _Job.stop:
            return {"PASS_THROUGH"}
        run = _Job.run
        if _Job.stop:
            run.cancel()
        elif run.code is None:
            context.scene.blurmatte.progress = run.stage
            context.workspace.status_text_set(f"blurmatte: {run.stage}; Esc stops it")
            _redraw(context)
            return {"RUNNING_MODAL"}
        context.window_manager.event_timer_remove(self._timer)
        context.workspace.status_text_set(None)
        return self._ended(context)

    def _ended(self, context):
        """Composite what was written, or say why there is nothing."""
        run, settings = _Job.run, context.scene.blurmatte
        _Job.run, settings.progress = None, ""
        _redraw(context)
        if _Job.stop:
            self.report({"WARNING"}, "stopped; a clip goes on where it was if it is solved again")
            return {"CANCELLED"}
        if run.code not in running.ANSWERED:
            self.report({"ERROR"}, run.complaint)
            return {"CANCELLED"}
        folder = folder_of(settings)
        settings.said = "\n".join(results.sentences_of(folder))
        if (folder / "layer.exr").is_file():  # of a single picture
            running.Run(self._command, running.measure_arguments(folder)).wait()
        self.report({"INFO"}, settings.said.partition("\n")[0])
        return bpy.ops.blurmatte.composite()


def _redraw(context):
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            area.tag_redraw()


class _OfResults:
    """An operator that places what was solved."""

    @classmethod
    def poll(cls, context):
        """Whether something was solved."""
        settings = context.scene.blurmatte
        return bool(settings.source or settings.folder) and bool(
            results.layers_of(folder_of(settings))
        )

    def execute(self, context):
        """Place it, or say why that is not possible."""
        settings, folder = context.scene.blurmatte, folder_of(context.scene.blurmatte)
        try:
            layer = scene.load_layer(folder, settings.first_frame)
            self.place(context, settings, folder, layer, size_of(folder, layer[0]))
        except (OSError, ValueError, RuntimeError) as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return {"FINISHED"}


class Composite(_OfResults, bpy.types.Operator):
    """Put the layer over the plate, or over what is composited now."""

    bl_idname = "blurmatte.composite"
    bl_label = "Into the compositor"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012

    def place(self, context, settings, folder, layer, size):
        """Make the nodes."""
        behind = None
        if settings.background == "PLATE":
            plate = Path(bpy.path.abspath(settings.plate or settings.source))
            behind = scene.load_plate(plate, settings.first_frame)
        scene.composite(context.scene, layer, behind, size if all(size) else None)
        if settings.standard:
            context.scene.view_settings.view_transform = "Standard"


class Plane(_OfResults, bpy.types.Operator):
    """Put the layer on a plane that fills the view of the camera."""

    bl_idname = "blurmatte.plane"
    bl_label = "As a plane before the camera"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012

    def place(self, context, _settings, _folder, layer, size):
        """Make the plane."""
        scene.add_plane(context.scene, layer, size)


class PathCurve(_OfResults, bpy.types.Operator):
    """Draw the path as a curve before the camera, and an empty that moves along it."""

    bl_idname = "blurmatte.path"
    bl_label = "Path as a curve"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012

    def place(self, context, _settings, folder, _layer, size):
        """Make curve and keyframes."""
        times, places = results.path_of(folder)
        if not places:
            raise ValueError(
                "the path was not measured: it is of a picture whose object has a shape"
            )
        scene.add_path(context.scene, times, places, size)


class Cancel(bpy.types.Operator):
    """Stop the command."""

    bl_idname = "blurmatte.cancel"
    bl_label = "Stop"

    def execute(self, _context):
        """Ask the run to stop."""
        _Job.stop = True
        return {"FINISHED"}


class Panel(bpy.types.Panel):
    """The panel in the sidebar of the 3D view, of the compositor and of the image editor."""

    bl_idname = "BLURMATTE_PT_panel"
    bl_label = "blurmatte"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "blurmatte"

    def draw(self, context):
        """Draw settings, progress, grade and what can be placed."""
        layout, settings = self.layout, context.scene.blurmatte
        if settings.progress and _Job.run is not None:
            for line in _wrapped(settings.progress):
                layout.label(text=line)
            layout.operator(Cancel.bl_idname, icon="CANCEL")
            return
        layout.operator(Solve.bl_idname, icon="FILE_FOLDER")
        for name in ("source", "plate", "folder", "first_frame", "background", "standard"):
            layout.prop(settings, name)
        if settings.source:
            row = layout.row()
            row.operator_context = "EXEC_DEFAULT"
            row.operator(Solve.bl_idname, text="Solve these", icon="PLAY").choose = False
        for sentence in settings.said.splitlines():
            for line in _wrapped(sentence):
                layout.label(text=line)
        for operator in (Composite, Plane, PathCurve):
            layout.operator(operator.bl_idname)


class NodePanel(Panel):
    """The same in the compositor."""

    bl_idname = "BLURMATTE_PT_nodes"
    bl_space_type = "NODE_EDITOR"


def _wrapped(text):
    """Lines of a panel."""
    lines = [""]
    for word in text.split():
        if lines[-1] and len(lines[-1]) + len(word) >= _LINE:
            lines.append("")
        lines[-1] = f"{lines[-1]} {word}".strip()
    return lines


_CLASSES = Preferences, Settings, Solve, Composite, Plane, PathCurve, Cancel, Panel, NodePanel


def register():
    """Make the add-on known to Blender."""
    for one in _CLASSES:
        bpy.utils.register_class(one)
    bpy.types.Scene.blurmatte = PointerProperty(type=Settings)


def unregister():
    """Remove it; a run is stopped."""
    if _Job.run is not None:
        _Job.run.cancel()
    del bpy.types.Scene.blurmatte
    for one in reversed(_CLASSES):
        bpy.utils.unregister_class(one)
