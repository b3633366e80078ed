"""The run folder: made once, locked by one, written whole or not at all; its configuration reads back."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from surfuse import durable
from surfuse.errors import ConfigError, DataError, StorageError
from surfuse.runs.configuration import read_configuration, write_configuration
from surfuse.runs.folder import RunFolder
from surfuse.runs.log_writer import LogWriter


def test_a_new_run_folder_has_its_names(tmp_path):
    run = RunFolder.create(tmp_path / "a b" / "Lauf ü")
    assert run.log.is_dir()
    names = {p.name for p in (run.log, run.surface, run.report, run.configuration, run.summary, run.truth)}
    assert names == {"log", "surface.nc", "report.html", "run.toml", "summary.json", "truth.ply"}


def test_an_existing_run_is_never_overwritten(tmp_path):
    RunFolder.create(tmp_path / "run").configuration.write_text("precious")
    with pytest.raises(StorageError, match=r"not empty.*--out"):
        RunFolder.create(tmp_path / "run")
    (tmp_path / "file").write_text("precious")
    with pytest.raises(StorageError, match="is a file"):
        RunFolder.create(tmp_path / "file")
    with pytest.raises(StorageError, match="folder"):
        RunFolder.create(tmp_path / "file" / "run")
    assert (tmp_path / "file").read_text() == "precious"
    (tmp_path / "empty").mkdir()
    RunFolder.create(tmp_path / "empty")


def test_what_was_killed_before_it_began_is_begun_again(tmp_path):
    run = RunFolder.create(tmp_path / "run")
    with run.lock():
        (run.path / ".run-77-0123abcd.toml").write_text("half a configurat")
    with pytest.raises(DataError, match="acquire into it again"):
        RunFolder.open(run.path)
    assert RunFolder.create(run.path) == run
    (run.log / "000.mcap").write_bytes(b"begun")
    with pytest.raises(StorageError, match="not empty"):
        RunFolder.create(run.path)


def test_a_place_that_cannot_be_written_is_a_storage_error(monkeypatch, tmp_path):
    def refuse(*arguments, **named):
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(Path, "mkdir", refuse)
    with pytest.raises(StorageError, match=r"Permission denied.*choose another folder") as caught:
        RunFolder.create(tmp_path / "run")
    assert caught.value.exit_status == 6


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="needs a file system that refuses everyone")
def test_a_read_only_file_system_is_a_storage_error():
    with pytest.raises(StorageError):
        RunFolder.create(Path("/proc/surfuse-run"))


def test_opening_names_what_is_missing(tmp_path, scans):
    with pytest.raises(DataError, match="no such folder"):
        RunFolder.open(tmp_path / "gone")
    with pytest.raises(DataError, match=r"run\.toml and log"):
        RunFolder.open(tmp_path)
    run = RunFolder.create(tmp_path / "run")
    write_configuration(run.configuration, {}, seed=1)
    with pytest.raises(DataError, match=r"log/\*\.mcap missing"):
        RunFolder.open(run.path)
    RunFolder.open(run.path, need_log=False)
    with LogWriter(run.log) as log:
        log.append_scene(scans.scene())
    assert RunFolder.open(run.path) == run


def test_a_second_process_is_refused_and_told_the_pid(tmp_path):
    run = RunFolder.create(tmp_path / "run")
    code = "import sys; from pathlib import Path; from surfuse.runs.folder import RunFolder\n"
    code += "with RunFolder(Path(sys.argv[1])).lock(): print('locked', flush=True); sys.stdin.read()"
    with subprocess.Popen(
        [sys.executable, "-c", code, str(run.path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as other:
        assert other.stdout.readline() == "locked\n"
        with pytest.raises(StorageError, match=rf"pid {other.pid}\b"), run.lock():
            pass
        other.kill()
        other.wait()
        other.stdin.close()
        with run.lock():
            assert (run.path / ".lock.pid").read_text().strip() == str(os.getpid())
    with run.lock():
        pass
    assert not (run.path / ".lock.pid").exists()


def test_the_lock_file_of_an_earlier_version_is_taken_as_it_is(tmp_path):
    run = RunFolder.create(tmp_path / "run")
    (run.path / ".lock").write_text("4711\n")
    with run.lock():
        pass
    assert RunFolder.create(run.path) == run


@pytest.mark.parametrize("name", [".lock", ".lock.pid"])
@pytest.mark.parametrize("there", [True, False])
def test_a_planted_link_is_not_followed(tmp_path, name, there):
    run, victim = RunFolder.create(tmp_path / "run"), tmp_path / "precious"
    if there:
        victim.write_text("precious")
    (run.path / name).symlink_to(victim)
    if name == ".lock":
        with pytest.raises(StorageError, match=r"\.lock: .*symbolic link.*remove"), run.lock():
            pass
    else:
        with run.lock():
            assert not (run.path / name).is_symlink()
    assert victim.exists() == there
    assert not there or victim.read_text() == "precious"


def test_a_folder_that_cannot_be_opened_is_not_synced(tmp_path, monkeypatch):
    opened = os.open

    def as_on_windows(path, *arguments, **named):
        if Path(path).is_dir():
            raise PermissionError(errno.EACCES, "Permission denied", str(path))
        return opened(path, *arguments, **named)

    monkeypatch.setattr(os, "open", as_on_windows)
    durable.write_text(tmp_path / "a.txt", "kept")
    assert (tmp_path / "a.txt").read_text() == "kept"


def test_an_old_file_that_a_reader_still_has_open_is_replaced_when_it_lets_go(tmp_path, monkeypatch):
    tries = []
    replace = Path.replace

    def busy_at_first(self, target):
        tries.append(target)
        if len(tries) < 3:
            raise PermissionError(errno.EACCES, "Permission denied")
        return replace(self, target)

    (tmp_path / "new").write_text("new")
    (tmp_path / "old").write_text("old")
    monkeypatch.setattr(Path, "replace", busy_at_first)
    monkeypatch.setattr(durable.files, "os", SimpleNamespace(name="nt"))
    monkeypatch.setattr(durable.files, "_REPLACE_WAIT_S", 0.0)
    durable.replace_file(tmp_path / "new", tmp_path / "old")
    assert (tmp_path / "old").read_text() == "new"


_PLAIN = st.one_of(
    st.booleans(),
    st.integers(min_value=-(2**62), max_value=2**62),
    st.floats(allow_nan=False, allow_infinity=False),
    st.text(alphabet=st.characters(codec="utf-8", exclude_characters="\x00"), max_size=12),
)
_KEYS = st.text(alphabet="abcdefgh_-ü .", min_size=1, max_size=8).filter(lambda key: key != "run")
_TABLES = st.dictionaries(
    _KEYS, st.one_of(_PLAIN, st.lists(_PLAIN, max_size=3), st.dictionaries(_KEYS, _PLAIN, max_size=3)), max_size=4
)


@settings(max_examples=60, deadline=None)
@given(_TABLES, st.integers(min_value=0, max_value=2**62))
def test_a_configuration_reads_back(tmp_path_factory, values, seed):
    path = tmp_path_factory.mktemp("run") / "run.toml"
    write_configuration(path, values, seed)
    assert read_configuration(path) == (values, seed)


def test_the_configuration_records_versions_and_leaves_none_out(tmp_path):
    path = tmp_path / "run.toml"
    write_configuration(path, {"sensor": {"frequency_hz": None, "gain": 3}, "name": None}, seed=7)
    assert read_configuration(path) == ({"sensor": {"gain": 3}}, 7)
    for name in ("surfuse", "python", "numpy", "seed = 7"):
        assert name in path.read_text()
    with pytest.raises(ConfigError, match="run"):
        write_configuration(path, {"run": 1}, seed=7)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("", "no table 'run'"),
        ("[run]\nseed = 'x'\n", "no table 'run' with a seed"),
        ("[run]\nseed = 1\nformat_version = 9\nsurfuse = '7.0'\n", r"version 9 \(surfuse 7.0\)"),
        ("[run]\nseed = 1\nseed = 2\n", "not valid TOML"),
        ("[run]\nseed = 1\nformat_version = 1\n[a]\nx = nan\n", r"a\.x = nan"),
        ("a = " + "{b = " * 3000, "TOML|nested"),
        ("x = 1\n" * 20000, "bytes"),
    ],
)
def test_a_damaged_configuration_is_refused_with_file_and_reason(tmp_path, content, words):
    path = tmp_path / "run.toml"
    path.write_text(content)
    with pytest.raises(ConfigError, match=words) as caught:
        read_configuration(path)
    assert "run.toml" in str(caught.value)


def test_a_failed_replacement_leaves_the_old_file_and_no_remains(tmp_path):
    path = tmp_path / "summary.json"
    durable.write_text(path, "old")

    def fail_halfway() -> None:
        with durable.replacing(path, overwrite=True) as temporary:
            temporary.write_text("half")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail_halfway()
    assert path.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["summary.json"]


@pytest.mark.parametrize("call", ["fsync", "link"])
def test_a_failure_while_publishing_leaves_nothing_or_everything(tmp_path, monkeypatch, call):
    def refuse(*arguments, **named):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(durable.files.os, call, refuse)
    path = tmp_path / "map.nc"
    if call == "fsync":
        with pytest.raises(StorageError, match="free some disk space"):
            durable.write_text(path, "new")
        assert list(tmp_path.iterdir()) == []
    else:
        durable.write_text(path, "new")
        assert path.read_text() == "new"


def test_a_full_device_is_a_storage_error(tmp_path, monkeypatch):
    path = tmp_path / "x.json"

    def to_full_device(self, content):
        with Path("/dev/full").open("wb", 0) as stream:
            return stream.write(content)

    monkeypatch.setattr(Path, "write_bytes", to_full_device)
    with pytest.raises(StorageError, match="No space left"):
        durable.write_text(path, "new")
    assert not path.exists()


def test_a_file_that_appears_meanwhile_is_not_overwritten(tmp_path):
    path = tmp_path / "x.json"

    def write_while_another_does() -> None:
        with durable.replacing(path) as temporary:
            temporary.write_text("mine")
            path.write_text("theirs")

    with pytest.raises(StorageError, match="exists"):
        write_while_another_does()
    assert path.read_text() == "theirs"
    assert [p.name for p in tmp_path.iterdir()] == ["x.json"]
