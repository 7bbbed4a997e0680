"""Text PLY files, read by columns where plyfile reads number by number."""

from pathlib import Path

import numpy as np
import pytest
from plyfile import PlyData

from lis_grasp.exceptions import InvalidFileError
from lis_grasp.io._ply import ply_bytes, ply_element, read_ply


def test_a_text_is_read_as_plyfile_reads_it(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    numbers = rng.normal(size=50) * 10.0 ** rng.integers(-30, 30, size=50)
    numbers[::7] = np.nan
    columns = {"x": numbers, "y": numbers.astype(np.float32), "n": np.arange(50, dtype=np.int32)}
    elements = [ply_element("vertex", columns), ply_element("free", {"r": numbers[:1]})]
    (tmp_path / "a.ply").write_bytes(ply_bytes(elements, "of end_header", text=True))
    ours, theirs = read_ply(tmp_path / "a.ply"), PlyData.read(str(tmp_path / "a.ply"))
    assert ours.header == theirs.header
    for name in ("vertex", "free"):
        assert ours[name].data.dtype == theirs[name].data.dtype
        assert ours[name].data.tobytes() == theirs[name].data.tobytes()


@pytest.mark.parametrize("rows", ["1 2\n", "1 2\n\n3 4\n", "1 2\n3\n", "1 2\n3.5 4\n"])
def test_rows_that_the_header_does_not_announce_are_refused(tmp_path: Path, rows: str) -> None:
    head = (
        "ply\nformat ascii 1.0\nelement vertex 2\nproperty int x\nproperty double y\nend_header\n"
    )
    (tmp_path / "a.ply").write_text(head + rows)
    with pytest.raises(InvalidFileError) as error:
        read_ply(tmp_path / "a.ply")
    assert error.value.path == tmp_path / "a.ply"
