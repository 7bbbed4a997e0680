"""Model directives of a world, from a directives file or a scenario, without what is no body."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pydrake.common.yaml import yaml_dump, yaml_load_data
from pydrake.multibody.parsing import (
    AddModel,
    FlattenModelDirectives,
    LoadModelDirectivesFromString,
    ModelDirective,
    ModelDirectives,
    PackageMap,
)

from lis_grasp.exceptions import InvalidFileError, listed, note
from lis_grasp.io.limits import MEBIBYTE, ReadError, reading

_MOST_BYTES = 2 * MEBIBYTE
_URI = re.compile(r"(?:package|model)://[^\"'<>\s]+")
_NETWORK = "DRAKE_ALLOW_NETWORK"


def load_directives(path: Path, scenario: str | None, packages: PackageMap) -> ModelDirectives:
    """Return the flat directives of a file, and warn of what they lack.

    `scenario` names one of several of a HardwareStation; None for the only one. Its models with
    drivers are robots and are left out, as are models whose files are not on this disk, and what is
    placed on one of both.

    Raises `InvalidFileError` if the file has no such directives, or Drake cannot read them.
    """
    content = _content_of(path, scenario)
    text = yaml_dump({"directives": content["directives"]})
    with drake_reads(path):
        directives = LoadModelDirectivesFromString(text)
        directives = FlattenModelDirectives(directives, packages).directives
    robots = set(content.get("model_drivers") or {})
    models = [d.add_model for d in directives if d.add_model is not None]
    lacking = {m.name: file for m in models if (file := _lacking_file(path, m, packages))}
    lacking = {name: file for name, file in lacking.items() if name not in robots}
    gone = _with_placed_on(directives, robots | set(lacking))
    names = [model.name for model in models]
    if lacking and not set(names) - robots - set(lacking):
        found = listed([f"{name} ({lacked})" for name, lacked in lacking.items()])
        raise InvalidFileError(
            f"{path} must have a model whose files are on this disk; it has {found}"
            f"{_without_package(path, lacking.values())}",
            path=path,
            field="directives",
        )
    _say(path, [n for n in names if n in robots], lacking, [n for n in names if n in gone])
    return ModelDirectives(directives=[d for d in directives if not _is_of(d, gone)])


def local_packages(path: Path) -> PackageMap:
    """Return the packages on this disk: Drake's own, and those of each package.xml above a file."""
    with drake_network("none"):  # reading `drake_models` for the first time would download it
        try:
            packages = PackageMap()
        except RuntimeError:  # it is not in Drake's cache
            packages = PackageMap.MakeEmpty()
    for folder in path.resolve().parents:
        if (file := folder / "package.xml").is_file():
            with drake_reads(file):
                packages.AddPackageXml(str(file))
    return packages


@contextmanager
def drake_network(allowed: str) -> Iterator[None]:
    """Set what Drake may use the network for: ``none``, or ``package_map``."""
    before = os.environ.get(_NETWORK)
    os.environ[_NETWORK] = allowed
    try:
        yield
    finally:
        os.environ.pop(_NETWORK)
        if before is not None:
            os.environ[_NETWORK] = before


@contextmanager
def drake_reads(path: Path) -> Iterator[None]:
    """Turn Drake's error about a file into an `InvalidFileError`."""
    try:
        yield
    except RuntimeError as error:
        reason = str(error).strip().splitlines()[0]
        raise InvalidFileError(f"Drake must be able to read {path}: {reason}", path=path) from None


def _content_of(path: Path, scenario: str | None) -> Mapping[str, Any]:
    """Return the mapping with the key ``directives`` in a file, of a scenario if it has several."""
    with reading(path, "model directives", most=_MOST_BYTES):
        content = yaml_load_data(path.read_text(encoding="utf-8"))
        if not isinstance(content, dict):
            raise ReadError("it has no key directives")
    if "directives" in content and scenario is None:
        return content
    found = {
        str(name): value
        for name, value in content.items()
        if isinstance(value, dict) and "directives" in value
    }
    if scenario is None and len(found) == 1:
        return next(iter(found.values()))
    if scenario not in found:
        has = f"it has {listed([*found])}" if found else "it has none"
        wanted = "one scenario, or be followed by #NAME" if scenario is None else f"#{scenario}"
        raise InvalidFileError(f"{path} must have {wanted}; {has}", path=path, field="directives")
    return found[scenario]


def _lacking_file(path: Path, model: AddModel, packages: PackageMap) -> str | None:
    """Return the first file of a model that is not on this disk; None if none lacks.

    Raises `InvalidFileError` for a missing file in a package that is here, or for a path that is no
    URL: both are mistakes.
    """
    if "://" not in model.file:
        raise InvalidFileError(
            f"the file of model '{model.name}' must be a URL, which Drake reads; it is"
            f" {model.file}: write file://{path.resolve().parent / model.file}, or a package://",
            path=path,
            field="directives",
        )
    try:
        file = Path(packages.ResolveUrl(model.file))
    except RuntimeError:
        return str(model.file)
    if not file.is_file():
        raise InvalidFileError(
            f"the file of model '{model.name}' must exist; there is no {file}: check {model.file}",
            path=file,
        )
    if file.suffix.lower() not in (".sdf", ".urdf", ".xml"):
        return None
    with reading(file, "a model", most=_MOST_BYTES):
        uris = _URI.findall(file.read_text(encoding="utf-8"))
    return next((uri for uri in uris if not _is_here(uri, packages)), None)


def _is_here(uri: str, packages: PackageMap) -> bool:
    try:
        return os.path.exists(packages.ResolveUrl(uri))
    except RuntimeError:
        return False


def _with_placed_on(directives: list[ModelDirective], gone: set[str]) -> set[str]:
    """Return names of models and frames, with those that are placed on one of them."""
    gone = set(gone)
    while True:
        count = len(gone)
        for directive in directives:
            name, bases = _placed(directive)
            if name and any(_is_in(base, gone) for base in bases):
                gone.add(name)
        if len(gone) == count:
            return gone


def _placed(directive: ModelDirective) -> tuple[str, list[str]]:
    """Return the model or frame that a directive places, and the frames that it is placed on."""
    if (model := directive.add_model) is not None:
        return model.name, [X.base_frame or "" for X in model.default_free_body_pose.values()]
    if (frame := directive.add_frame) is not None:
        return frame.name, [frame.X_PF.base_frame or ""]
    if (weld := directive.add_weld) is not None:
        return weld.child.rpartition("::")[0] or weld.child, [weld.parent]
    return "", []


def _is_of(directive: ModelDirective, gone: set[str]) -> bool:
    """Return whether a directive has no meaning without some models and frames, or makes one."""
    # Filters of collisions say nothing about shapes.
    if directive.add_collision_filter_group is not None:
        return True
    name, bases = _placed(directive)
    return any(_is_in(used, gone) for used in (name, *bases))


def _is_in(frame: str, names: set[str]) -> bool:
    return any(frame == name or frame.startswith(f"{name}::") for name in names)


def _say(
    file: Path,
    robots: list[str],
    lacking: Mapping[str, str],
    gone: list[str],
) -> None:
    """Warn of the models that are left out."""
    if robots:
        note(
            f"{file.name} is read without its robots {listed(robots)}: `hand` and `arm` name yours"
        )
    if lacking:
        models = listed([f"{name} ({lacked})" for name, lacked in lacking.items()])
        note(
            f"{file.name} is read without models whose files are not on this disk, and the hand"
            f" does not avoid them: {models}{_without_package(file, lacking.values())}"
        )
    if placed := [name for name in gone if name not in robots and name not in lacking]:
        note(f"{file.name} is read without {listed(placed)}, placed on what is left out")


def _without_package(file: Path, uris: Iterable[str]) -> str:
    """Return which package of URLs is at or above a file but lacks its package.xml, in words."""
    for uri in uris:
        name, _, inside = uri.partition("://")[2].partition("/")
        for folder in file.resolve().parents if uri.startswith("package://") and inside else ():
            if (folder / inside).is_file():
                return (
                    f"; {folder / inside} is there, but no package.xml names the package {name}:"
                    f" write <package><name>{name}</name></package> to {folder / 'package.xml'}"
                )
    return ""
