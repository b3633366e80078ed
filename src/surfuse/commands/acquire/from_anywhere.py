"""A configuration whose files are named by whole paths, so that what a run says of itself holds in every folder."""

from __future__ import annotations

from pathlib import Path

from surfuse.rig.real.recordings import with_whole_log
from surfuse.settings import ArmSettings, Settings
from surfuse.settings.named_files import command_from_anywhere


def from_anywhere(settings: Settings) -> Settings:
    """The same with the whole paths of all files, logs and programs, so that a resume may start in another folder."""
    mesh, arm, area = Path(settings.scene.name), settings.arm, settings.area
    scene = {"name": str(mesh.resolve())} if mesh.is_file() else {}
    changed: dict[str, object] = {
        "scene": settings.scene.model_copy(update=scene),
        "arm": _arm_from_anywhere(arm),
        "sensor": tuple(with_whole_log(sensor) for sensor in settings.sensor),
    }
    if area is not None:
        files = {key: str(Path(name).resolve()) for key in ("outline", "mesh") if (name := getattr(area, key))}
        changed["area"] = area.model_copy(update=files)
    camera, recording = settings.camera, settings.camera.parameters.get("source")
    if isinstance(recording, str):
        whole = {**camera.parameters, "source": str(Path(recording).resolve())}
        changed["camera"] = camera.model_copy(update={"parameters": whole})
    return settings.model_copy(update=changed)


def _arm_from_anywhere(arm: ArmSettings) -> ArmSettings:
    """The same for the arm: its file, the log that it plays back, and the words of its command that are files."""
    changed: dict[str, object] = {} if arm.file is None else {"file": str(Path(arm.file).resolve())}
    command = arm.parameters.get("command")
    if isinstance(command, list) and command:
        words = command_from_anywhere([str(word) for word in command])
        changed["parameters"] = {**arm.parameters, "command": words}
    return with_whole_log(arm.model_copy(update=changed))
