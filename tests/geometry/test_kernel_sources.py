"""A kernel's key changes with every source that it is made from, and with no other."""

from __future__ import annotations

from pathlib import Path

import pytest

from surfuse.geometry import kernel_sources


def key(root: Path) -> str:
    for remembered in (kernel_sources._source, kernel_sources._digest, kernel_sources._imported, kernel_sources._files):
        remembered.cache_clear()
    return kernel_sources.sources_key(root / "mine" / "kernels.py", "mine.kernels")


@pytest.fixture
def package(tmp_path: Path) -> Path:
    folder = tmp_path / "mine"
    folder.mkdir()
    (folder / "__init__.py").write_text("")
    (folder / "kernels.py").write_text("import math\nfrom mine.middle import (\n    double,  # a kernel\n)\n")
    (folder / "middle.py").write_text("from mine import deep\n\ndef double(x):\n    from mine import late\n")
    (folder / "deep.py").write_text("LIMIT = 1\n")
    (folder / "late.py").write_text("LIMIT = 1\n")
    (folder / "other.py").write_text("LIMIT = 1\n")
    return tmp_path


@pytest.mark.parametrize("name", ["kernels.py", "middle.py", "deep.py", "__init__.py"])
def test_every_source_that_a_kernel_can_see_counts(package: Path, name: str) -> None:
    before = key(package)
    file = package / "mine" / name
    file.write_text(file.read_text() + "# changed\n")
    assert key(package) != before


@pytest.mark.parametrize("name", ["late.py", "other.py"])
def test_what_it_cannot_see_does_not_count(package: Path, name: str) -> None:
    before = key(package)
    (package / "mine" / name).write_text("LIMIT = 2\n")
    assert key(package) == before


def test_the_same_text_at_another_time_is_the_same(package: Path) -> None:
    before = key(package)
    file = package / "mine" / "deep.py"
    file.write_text(file.read_text())
    assert key(package) == before


def test_circles_end(package: Path) -> None:
    (package / "mine" / "deep.py").write_text("from mine.kernels import double\n")
    assert key(package)


def test_a_package_of_ones_own_is_followed_into_surfuse(package: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (package / "mine" / "kernels.py").write_text("from surfuse.geometry.polygons import signed_distance_at\n")
    before = key(package)
    read = Path.read_bytes
    monkeypatch.setattr(Path, "read_bytes", lambda path: read(path) + (b"#" if path.name == "polygons.py" else b""))
    assert key(package) != before
