"""Arrays of .npz files: what is larger than it seems is refused before it is unpacked."""

import io
import tracemalloc
import zipfile
from pathlib import Path

import numpy as np
import pytest

from lis_grasp.exceptions import InvalidFileError
from lis_grasp.io.limits import read_arrays


def _write(path: Path, content: bytes) -> None:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a.npy", content)


def _npy(shape: str, descr: str = "<f8", data: bytes = b"") -> bytes:
    header = f"{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}}}".encode()
    header += b" " * (-(len(header) + 11) % 64) + b"\n"
    return b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header + data


def test_arrays_come_back(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    np.savez_compressed(path, a=np.arange(3.0), b=np.array(["x", "yy"]))
    b, a = read_arrays(path, ("b", "a")).values()
    assert list(b) == ["x", "yy"]
    assert list(a) == [0.0, 1.0, 2.0]


def test_a_file_that_unpacks_to_much_is_refused_before_it_is_unpacked(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("a.npy", "w", force_zip64=True) as member,
    ):
        member.write(_npy("(40000000,)"))
        for _ in range(320):
            member.write(bytes(10**6))
    assert path.stat().st_size < 10**6
    tracemalloc.start()
    with pytest.raises(InvalidFileError) as error:
        read_arrays(path, ("a",))
    assert error.value.path == path
    assert tracemalloc.get_traced_memory()[1] < 10**7
    tracemalloc.stop()


@pytest.mark.parametrize(
    "content",
    [
        _npy("(100000000000,)"),
        _npy("(4,)", "|O", bytes(32)),
        _npy("(-1,)"),
        _npy("'x'"),
        b"",
        b"\x93NUMPY\x09\x00",
    ],
)
def test_a_damaged_array_is_one_sentence(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "a.npz"
    _write(path, content)
    with pytest.raises(InvalidFileError) as error:
        read_arrays(path, ("a",))
    assert error.value.path == path


def test_a_missing_array_and_a_missing_file_are_named(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    with pytest.raises(InvalidFileError) as error:
        read_arrays(path, ("a",))
    assert error.value.path == path
    _write(path, _npy("(0,)"))
    with pytest.raises(InvalidFileError) as error:
        read_arrays(path, ("b",))
    assert error.value.path == path
    path.write_bytes(io.BytesIO(b"PK").getvalue())
    with pytest.raises(InvalidFileError) as error:
        read_arrays(path, ("a",))
    assert error.value.path == path
