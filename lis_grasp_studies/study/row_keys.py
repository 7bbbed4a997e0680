"""Keys of a study's rows: hashes that are the same on every machine and in every folder."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict
from functools import cache
from pathlib import Path
from typing import Any

from lis_grasp.exceptions import InvalidFileError
from lis_grasp.pipeline.plugged_in import POLICY_NAMES
from lis_grasp.robots.shipped_models import HAND_NAMES, VENDOR_HANDS, hand_path
from lis_grasp.robots.yaml_files import description_of
from lis_grasp_studies.compared_estimators import COMPARED
from lis_grasp_studies.study.trial import (
    DEFAULT_CONDITIONS,
    OBJECT_NAMES,
    OWN,
    TRIAL_COLUMNS,
    TRUTH,
    Trial,
    label,
)

KEY_LENGTH = 16


def row_key(trial: Trial, estimator: str) -> str:
    """Return the key of a row: a hash of everything that decides its content.

    An object's mesh file and a hand's YAML, URDF and SDF count by name and content, not by folder;
    plug-ins by name and source file.
    """
    digests = [*file_digests(trial.object, trial.hand), *_plugin_digests(trial, estimator)]
    setup = asdict(trial.setup)
    if setup["conditions"] == DEFAULT_CONDITIONS:  # keys of before there were others stay
        del setup["conditions"]
    text = json.dumps([columns_of(trial), setup, estimator, *digests], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:KEY_LENGTH]


def columns_of(trial: Trial) -> dict[str, Any]:
    """Return the columns of a row that identify its trial within a study."""
    values = {name: getattr(trial, name) for name in TRIAL_COLUMNS}
    return values | {"object": label(trial.object), "hand": label(trial.hand)}


def file_digests(object_name: str, hand_name: str) -> tuple[str, ...]:
    """Return hashes of the files of an object and a hand; none of built-in ones."""
    files = [] if object_name in OBJECT_NAMES else [Path(object_name)]
    if hand_name in VENDOR_HANDS:
        files += [hand_path(hand_name), description_of(hand_name)[0]]
    elif hand_name not in HAND_NAMES:
        hand = Path(hand_name)
        hand = hand if hand.suffix else hand_path(hand_name)  # of an installed package
        files += [hand, *sorted(hand.parent.glob("*.urdf")), *sorted(hand.parent.glob("*.sdf"))]
    return tuple(map(_file_digest, files))


def _plugin_digests(trial: Trial, estimator: str) -> list[str]:
    """Return hashes of the sources of plugged-in estimators and policies."""
    estimators = {estimator, trial.setup.explorer} - {TRUTH, OWN}
    digests = [COMPARED.digest(name) for name in sorted(estimators)]
    return [digest for digest in (*digests, POLICY_NAMES.digest(trial.setup.policy)) if digest]


def object_digest(name: str) -> str | None:
    """Return a hash of an object's mesh file; None for one known by name."""
    return None if name in OBJECT_NAMES else _file_digest(Path(name))


def _file_digest(path: Path) -> str:
    try:
        facts = path.stat()
        return _digest(path, facts.st_mtime_ns, facts.st_size)
    except OSError as error:
        raise InvalidFileError(f"cannot read {path}: {error.strerror}", path=path) from None


@cache
def _digest(path: Path, _changed: int, _size: int) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
