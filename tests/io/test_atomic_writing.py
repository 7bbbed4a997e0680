import errno
import os
import stat
from pathlib import Path

import numpy as np
import pytest
import trimesh

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidFileError
from lis_grasp.io.atomic_writing import whole_file, write_json, write_text
from lis_grasp.io.surface_files import save_surface


def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "result.txt"
    path.write_text("old")
    with pytest.raises(RuntimeError), whole_file(path) as temporary:
        temporary.write_text("half")
        raise RuntimeError
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_finished_write_replaces_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "result.txt"
    with whole_file(path) as temporary:
        temporary.write_text("new")
        assert not path.exists()
    assert path.read_text() == "new"
    assert list(path.parent.iterdir()) == [path]


def test_a_full_disk_is_reported_and_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "contacts.csv"
    path.write_text("old")
    full = OSError(errno.ENOSPC, "No space left on device")
    with pytest.raises(InvalidFileError) as error, whole_file(path) as temporary:
        temporary.write_text("half")
        raise full
    assert error.value.path == path
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_contacts_and_surfaces_replace_files_atomically(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    contacts = Contacts(np.eye(3), np.eye(3))
    mesh = trimesh.creation.box()
    contacts.save(tmp_path / "contacts.ply")
    save_surface(mesh, tmp_path / "surface.ply")
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}

    def write_half(self: Path, content: bytes) -> int:
        with self.open("wb") as file:
            file.write(content[: len(content) // 2])
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", write_half)
    with pytest.raises(InvalidFileError) as error:
        contacts.subset(slice(2)).save(tmp_path / "contacts.ply")
    assert error.value.path == tmp_path / "contacts.ply"
    with pytest.raises(InvalidFileError) as error:
        save_surface(trimesh.creation.icosphere(), tmp_path / "surface.ply")
    assert error.value.path == tmp_path / "surface.ply"
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_json_refuses_nan(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="not JSON compliant"):
        write_json(tmp_path / "x.json", {"a": float("nan")})


def test_an_unwritable_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with (
        pytest.raises(InvalidFileError) as error,
        whole_file(tmp_path / "file" / "x"),
    ):
        pass
    assert error.value.path == tmp_path / "file" / "x"


@pytest.mark.parametrize("umask", [0o022, 0o027, 0o077])
def test_files_get_the_mode_of_the_umask(tmp_path: Path, umask: int) -> None:
    before = os.umask(umask)
    try:
        write_text(tmp_path / "a.txt", "a")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "a.txt").stat().st_mode) == 0o666 & ~umask


def test_no_device_pipe_or_folder_is_replaced(tmp_path: Path) -> None:
    pipe, folder = tmp_path / "pipe", tmp_path / "folder"
    os.mkfifo(pipe)
    folder.mkdir()
    for path in (pipe, folder):
        with pytest.raises(InvalidFileError) as error:
            write_text(path, "x")
        assert error.value.path == path
    assert stat.S_ISFIFO(pipe.stat().st_mode)
    assert {*tmp_path.iterdir()} == {pipe, folder}
