"""What importing surfuse loads, and what it offers."""

from __future__ import annotations

import ast
import json
import subprocess
import sys
from pathlib import Path

import pytest

import surfuse

HEAVY = ("numba", "cv2", "scipy", "trimesh", "embreex", "can", "mcap", "pydantic", "typer", "viser", "h5py", "mujoco")


def loaded_by(code: str) -> set[str]:
    """Names of the modules in a fresh interpreter after some code."""
    script = (
        f"import json, sys\nbefore = set(sys.modules)\n{code}\nprint(json.dumps(sorted(set(sys.modules) - before)))"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    return set(json.loads(done.stdout))


def test_importing_surfuse_loads_nothing_else():
    loaded = loaded_by("import surfuse")
    foreign = {name.partition(".")[0] for name in loaded} - set(sys.stdlib_module_names)
    assert foreign == {"surfuse"}
    assert {name for name in loaded if name.startswith("surfuse")} == {"surfuse"}


def test_naming_an_error_loads_nothing_heavy():
    assert not loaded_by("import surfuse; surfuse.SurfuseError, dir(surfuse)") & {"numpy", *HEAVY}


def test_fusing_arrays_loads_no_simulator_no_camera_and_no_command_line():
    loaded = loaded_by(
        "import surfuse\nfor name in ('log', 'read', 'fuse', 'Sensor', 'open_map', 'evaluate'):\n"
        "    getattr(surfuse, name)"
    )
    assert "surfuse.door.maps" in loaded
    rooms = ("surfuse.twin", "surfuse.rig", "surfuse.cli", "surfuse.report", "surfuse.node", "surfuse.arms")
    assert not [name for name in loaded if name.startswith(rooms)]
    assert not loaded & {"cv2", "can", "viser", "typer", "mujoco", "matplotlib", "xarray", "pandas"}


def test_the_door_sets_up_no_logging():
    loaded_by("import logging, surfuse\nsurfuse.fuse, surfuse.acquire\nassert not logging.root.handlers")


def test_every_name_of_the_door_is_there_and_stays():
    assert dir(surfuse) == sorted(surfuse.__all__)
    for name in surfuse.__all__:
        assert getattr(surfuse, name) is getattr(surfuse, name)


def test_the_calls_are_calls_also_after_every_room_was_loaded():
    code = (
        "import importlib, pkgutil, surfuse\n"
        "for room in pkgutil.iter_modules(surfuse.__path__):\n"
        "    if room.name != '__main__':\n"
        "        importlib.import_module(f'surfuse.{room.name}')\n"
        "for name in surfuse.__all__:\n"
        "    value = getattr(surfuse, name)\n"
        "    assert name == '__version__' or callable(value), name\n"
    )
    loaded_by(code)


def test_type_checkers_see_the_same_names_from_the_same_modules():
    tree = ast.parse(Path(surfuse.__file__).read_text("utf-8"))
    typed = {
        alias.name: node.module.removeprefix("surfuse.")
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and node.module.startswith("surfuse.")
        for alias in node.names
    }
    assert typed == surfuse._HOMES
    assert set(surfuse.__all__) == {*typed, "__version__"}


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'fusee'"):
        surfuse.fusee  # noqa: B018


def test_the_package_runs_as_the_command_line():
    done = subprocess.run([sys.executable, "-m", "surfuse", "--version"], capture_output=True, text=True, check=True)
    assert done.stdout == f"surfuse {surfuse.__version__}\n"
    wrong = subprocess.run([sys.executable, "-m", "surfuse", "aquire"], capture_output=True, text=True, check=False)
    assert wrong.returncode == 2
    assert wrong.stderr.startswith("surfuse: unknown command 'aquire'")
