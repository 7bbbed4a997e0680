"""The lies of the study are what their kinds say."""

import numpy as np
import pytest

from lis_grasp_studies.contact_study.contact_sets import ContactCase, contact_set
from lis_grasp_studies.contact_study.lies import FLIPPED, LIES, STRAY, LieTrial, measure, tell

TRUE = contact_set("box", ContactCase("even", 40), 9).exact


@pytest.mark.parametrize("kind", LIES)
def test_a_lie_changes_what_its_codes_say(kind: str) -> None:
    told, codes = tell(TRUE, kind, rng=np.random.default_rng(0))
    assert np.count_nonzero(codes != STRAY) == len(TRUE)
    for point, normal, code in zip(told.points, told.normals, codes, strict=True):
        (same,) = np.nonzero(np.all(TRUE.points == point, axis=1))
        if code == STRAY:
            assert not len(same)
            continue
        cosine = float(normal @ TRUE.normals[same[0]])
        assert cosine == pytest.approx(1.0 if code == 0 else -1.0) or code not in (0, FLIPPED)
    _, strays, distance = LIES[kind]
    if strays == 0 and distance:
        (stray,) = told.points[codes == STRAY]
        apart = np.linalg.norm(TRUE.points - stray, axis=1).min()
        assert apart == pytest.approx(distance * TRUE.extent, rel=0.05)


def test_a_flip_on_a_box_is_put_right() -> None:
    row = measure(LieTrial("box", "even", 40, 0.0, 0.0, 9, 0), "one flip")
    assert row["right"]
    assert (row["bad"], row["found"], row["false"]) == (1, 1, 0)
