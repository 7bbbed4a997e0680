"""A frozen protocol: its tracks by kind of plug-in, and what its file promises."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidFileError, InvalidOptionError, LisGraspError
from lis_grasp.exploration.policy import POLICY_NAMES
from lis_grasp.exploration.workspace import Workspace
from lis_grasp.grasping.samplers import PLANNER_NAMES
from lis_grasp.io.schemas import checked
from lis_grasp.io.yaml_files import read_yaml
from lis_grasp.plugins import Registry
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.shipped_models import READY_HANDS
from lis_grasp.surfaces.estimators import ESTIMATOR_NAMES
from lis_grasp_studies.benchmark.objects import FOLDER, digest_of_arrays, stored_objects
from lis_grasp_studies.benchmark.tracks import (
    Compared,
    HandsTrack,
    LiftsTrack,
    PlannersTrack,
    PoliciesTrack,
    SurfacesTrack,
)
from lis_grasp_studies.evaluation.configuration import Configuration
from lis_grasp_studies.evaluation.touched_shapes import HULL, TRUTH

AnyTrack = SurfacesTrack | LiftsTrack | PoliciesTrack | PlannersTrack | HandsTrack

_YAML = (".yaml", ".yml")


class Protocol(BaseModel):
    """A version of the benchmark."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)

    version: int = Field(ge=1)
    salt: str
    """Of the objects, taken after everything that they judge was fixed."""
    objects: str
    """Digest of objects and contacts."""
    judge: Mapping[str, float]
    """Numbers that the judge finds of known surfaces, by their names."""
    tracks: dict[str, Annotated[AnyTrack, Field(discriminator="measure")]]

    @classmethod
    def load(cls, version: int = 1) -> Protocol:
        """Return a version of the protocol.

        Raises `InvalidFileError` if its objects are not those that it names.
        """
        path = FOLDER / f"protocol_{version}.yaml"
        protocol: Protocol = checked(cls, read_yaml(path), path, "protocol")
        digest = digest_of_arrays(stored_objects(version))
        if digest != protocol.objects:
            raise InvalidFileError.of(
                path,
                f"needs objects of digest {protocol.objects}; those here have {digest}: install"
                " the package again",
            )
        return protocol

    def configuration(
        self, kind: Compared, name: str, *, quick: bool = False, tracks: list[str] | None = None
    ) -> Configuration:
        """Return what is measured of a plug-in: its tracks, by default all of its kind.

        Raises `InvalidOptionError` for a track that its kind has not.
        """
        of_kind = {key: track for key, track in self.tracks.items() if track.compares == kind}
        for key in tracks or ():
            if key not in of_kind:
                raise InvalidOptionError.not_one_of("--tracks", key, tuple(of_kind))
        parts = {
            key: track.model_copy(
                update={"variants": [name]} | ({"objects": track.quick} if quick else {})
            )
            for key, track in of_kind.items()
            if not tracks or key in tracks
        }
        return Configuration.model_construct(parts=parts)

    def baselines(self, kind: Compared) -> list[str]:
        """Return the names of a kind's baselines."""
        of_kind = [track for track in self.tracks.values() if track.compares == kind]
        return list(dict.fromkeys(name for track in of_kind for name in track.variants))


def kind_of(name: str) -> Compared:
    """Return what a name stands for: an estimator, a policy, a planner or a hand, by what it does.

    Something at ``my.module:Class`` is an estimator if it makes an object with ``evaluate`` of
    contacts, a policy if it makes one with ``next_probe`` of a workspace, and a planner if it makes
    one with ``sample`` of a hand.

    Raises
    ------
    InvalidOptionError
        If there is no such name, it is none of these, or it needs a package that is missing.
    """
    if name in (HULL, TRUTH) or name in ESTIMATOR_NAMES.names:
        return "estimator"
    if name in POLICY_NAMES.names:
        return "policy"
    if name in PLANNER_NAMES.names:
        return "planner"
    if name in (*READY_HANDS, *_HAND_NAMES.names) or name.endswith(_YAML):
        return "hand"
    if ":" not in name:
        own = (ESTIMATOR_NAMES, POLICY_NAMES, PLANNER_NAMES)
        choices = (*(n for of in own for n in of.names), *READY_HANDS, "my.module:Class")
        raise InvalidOptionError.not_one_of("NAME", name, choices)
    return _kind_by_use(name)


_HAND_NAMES = Registry("hand", {})


def _kind_by_use(name: str) -> Compared:
    found = ESTIMATOR_NAMES.find(name)
    axes = np.vstack([np.eye(3), -np.eye(3)])
    contacts = Contacts(0.03 * axes, axes)
    space = Workspace(0.015, np.zeros(3), 0.06)
    kinds: dict[str, Compared] = {
        "evaluate": "estimator",
        "next_probe": "policy",
        "sample": "planner",
    }
    reasons = []
    for argument in (contacts, space, Hand.load("wsg50")):
        make = getattr(found, "from_contacts", found)
        try:
            made = make(argument)
        except Exception as error:
            if isinstance(error, LisGraspError) and isinstance(error.__context__, ImportError):
                raise  # a package that is not installed
            reasons.append(f"of {type(argument).__name__}: {type(error).__name__}: {error}")
            continue
        found_kinds = [kind for member, kind in kinds.items() if hasattr(made, member)]
        if found_kinds:
            return found_kinds[0]
        reasons.append(f"of {type(argument).__name__} it made a {type(made).__name__}")
    raise InvalidOptionError(
        f"'{name}' must make an object with evaluate of Contacts, one with next_probe of a"
        f" Workspace, or one with sample of a Hand; {'; '.join(reasons)}",
        option="NAME",
        value=name,
    )
