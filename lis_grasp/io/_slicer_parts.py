"""Parts of a 3MF project that slicers mark as helpers, not as matter."""

from __future__ import annotations

import zipfile
from collections.abc import Callable, Iterator, Mapping
from xml.etree.ElementTree import Element

import numpy as np

from lis_grasp.exceptions import counted
from lis_grasp.io.limits import ReadError
from lis_grasp.typing import BoolArray

_CUT = "a negative part"  # which a slicer subtracts

# Bambu Studio and OrcaSlicer name the kinds of parts like this, PrusaSlicer the kinds of volumes,
# and Cura the kinds of meshes. Other names denote matter.
_KINDS: Mapping[str, str] = {
    "negative_part": _CUT,
    "modifier_part": "a modifier",
    "support_blocker": "a support blocker",
    "support_enforcer": "a support enforcer",
    "NegativeVolume": _CUT,
    "ParameterModifier": "a modifier",
    "SupportBlocker": "a support blocker",
    "SupportEnforcer": "a support enforcer",
    "cutting_mesh": _CUT,
    "infill_mesh": "a modifier",
    "support_mesh": "a support",
    "anti_overhang_mesh": "a support blocker",
}
_CONFIGURATIONS = ("Metadata/model_settings.config", "Metadata/Slic3r_PE_model.config")


class SlicerParts:
    """Kinds of the parts of a project that a slicer does not print as matter."""

    def __init__(self, archive: zipfile.ZipFile, parsed: Callable[[bytes], Element]) -> None:
        present = set(archive.namelist())
        roots = [parsed(archive.read(name)) for name in _CONFIGURATIONS if name in present]
        objects = [each for root in roots for each in root.iter("object")]
        self._parts = {
            (each.get("id", ""), part.get("id", "")): _KINDS.get(part.get("subtype", ""), "")
            for each in objects
            for part in each.iter("part")
        }
        self._volumes = {each.get("id", ""): list(_volumes(each)) for each in objects}

    def kind(self, owner: str, number: str, element: Element) -> str:
        """Return the kind of an object, perhaps a component of `owner`; empty for matter."""
        kind = element.get("type", "model")
        if found := self._parts.get((owner, number)) or _of_cura(element):
            return found
        return "" if kind == "model" else f"of the type {kind}"

    def printed(self, number: str, count: int) -> tuple[BoolArray, list[str]]:
        """Return which of `count` triangles of an object are matter, and kinds of the others."""
        kept, kinds = np.ones(count, dtype=np.bool_), []
        for first, last, kind in self._volumes.get(number, []):
            if kind:
                kept[first : last + 1] = False
                kinds.append(kind)
        return kept, kinds


def left_out(kinds: list[str]) -> tuple[str, ...]:
    """Return the kinds that are left out of an object; `ReadError` if one is subtracted."""
    if _CUT in kinds:
        raise ReadError(
            f"it has {_CUT}, which is not subtracted",
            "export the object as STL from the slicer, which subtracts it",
        )
    return tuple(
        f"left out {counted(kinds.count(kind), 'part')} that is no matter: {kind}"
        for kind in dict.fromkeys(kinds)
    )


def _volumes(element: Element) -> Iterator[tuple[int, int, str]]:
    """Yield the first and last triangle of each volume, and its kind; empty for matter."""
    for volume in element.iter("volume"):
        facts = {each.get("key", ""): each.get("value", "") for each in volume.iter("metadata")}
        kind = _KINDS.get(facts.get("volume_type", ""), "")
        if not kind and facts.get("modifier") == "1":  # before PrusaSlicer 1.41
            kind = _KINDS["ParameterModifier"]
        yield int(volume.get("firstid", "0")), int(volume.get("lastid", "-1")), kind


def _of_cura(element: Element) -> str:
    groups = [g for g in element if not str(g.tag).endswith(("}mesh", "}components"))]
    for each in (setting for group in groups for setting in group.iter()):
        name = each.get("name", "").rpartition(":")[2]
        if name in _KINDS and (each.text or "").strip().lower() == "true":
            return _KINDS[name]
    return ""
