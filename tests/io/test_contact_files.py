"""Files of points by their endings."""

from pathlib import Path

import pytest
import trimesh

from lis_grasp.exceptions import InvalidFileError
from lis_grasp.io.contact_files import read_point_file


@pytest.mark.parametrize(
    ("name", "advice"),
    [
        ("part.ply", r"surface of 12 faces: `lis-grasp grasp .*part\.ply` plans on it; contacts"),
        ("part.off", r"surface of 12 faces: `lis-grasp grasp .*part\.off` plans on it; contacts"),
        ("part.glb", r"if it is a mesh, `lis-grasp grasp .*part\.glb` plans on it$"),
        ("scan.e57", r"save it as \.ply by CloudCompare$"),
        ("points.json", r"write points as columns x,y,z of a \.csv$"),
    ],
)
def test_a_file_of_no_points_is_refused_with_what_reads_it(
    tmp_path: Path, name: str, advice: str
) -> None:
    if name.startswith("part") and "glb" not in name:
        trimesh.creation.box((0.1, 0.1, 0.1)).export(tmp_path / name)
    else:
        (tmp_path / name).write_text("any text")
    with pytest.raises(InvalidFileError, match=advice):
        read_point_file(tmp_path / name)
