"""Files of points by their endings."""

from pathlib import Path

import pytest

from lis_grasp.exceptions import InvalidFileError
from lis_grasp.io.contact_files import read_point_file


@pytest.mark.parametrize(
    ("name", "advice"),
    [
        ("part.glb", r"if it is a mesh, `lis-grasp grasp .*part\.glb` plans on it$"),
        ("scan.e57", r"save it as \.ply by CloudCompare$"),
        ("points.json", r"write points as columns x,y,z of a \.csv$"),
    ],
)
def test_a_file_of_no_points_is_refused_with_what_reads_it(
    tmp_path: Path, name: str, advice: str
) -> None:
    (tmp_path / name).write_text("any text")
    with pytest.raises(InvalidFileError, match=advice):
        read_point_file(tmp_path / name)
