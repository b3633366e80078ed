"""The second process that compiles: it runs our code alone, and is not started for nothing."""

from __future__ import annotations

from pathlib import Path

import pytest

from surfuse.commands.acquire import warm_up


@pytest.mark.timeout(600)
def test_a_module_in_the_current_folder_is_not_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("numpy", "subprocess", "hashlib", "surfuse"):
        (tmp_path / f"{name}.py").write_text("import pathlib; pathlib.Path('was_run').touch(); raise SystemExit(1)")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(warm_up, "_stamp", lambda method: tmp_path / "never")
    process = warm_up.start_warm_up("mean")
    assert process is not None
    assert process.wait(600) == 0
    assert not (tmp_path / "was_run").exists()


def test_what_was_compiled_is_not_compiled_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(warm_up, "_stamp", lambda method: tmp_path / method)
    (tmp_path / "mean").touch()
    assert warm_up.start_warm_up("mean") is None


def test_the_stamp_is_left_at_the_end_and_belongs_to_the_method(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert warm_up._stamp("mean") != warm_up._stamp("median")
    monkeypatch.setattr(warm_up, "_stamp", lambda method: tmp_path / method)
    monkeypatch.setattr(warm_up, "compile_fusion", lambda method: None)
    warm_up.compile_last("mean")
    assert [path.name for path in tmp_path.iterdir()] == ["mean"]
