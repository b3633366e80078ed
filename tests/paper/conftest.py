"""One acquisition of each of the paper's scenes, with the paper's method, for all tests of this folder."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from surfuse.commands.acquire.acquisition import acquire
from surfuse.commands.outcome import SilentWatcher
from surfuse.settings import load


@pytest.fixture(scope="session")
def experiment(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """The run folder of a scene, acquired once."""
    folder = tmp_path_factory.mktemp("paper")
    done: dict[str, Path] = {}

    def run(scene: str) -> Path:
        if scene not in done:
            settings = load(None, [f"scene.name={scene}", "fusion.method=weighted_average", "arm.driver=kinematic"])
            assert acquire(settings, folder / scene, SilentWatcher()).complete
            done[scene] = folder / scene
        return done[scene]

    return run
