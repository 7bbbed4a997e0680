"""Files of a release: one version everywhere, and commands that exist."""

import json
import re
import runpy
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

import lis_grasp
from lis_grasp.cli.main import build_parser

ROOT = Path(__file__).parents[1]
if not (ROOT / ".ci").exists():
    pytest.skip("needs the repository", allow_module_level=True)
release = runpy.run_path(str(ROOT / ".ci" / "release.py"))


def _project(folder: Path, version: str, changelog: str) -> Path:
    (folder / "lis_grasp").mkdir()
    (folder / "lis_grasp" / "version.py").write_text(f'__version__ = "{version}"\n')
    (folder / "CITATION.cff").write_text(f"version: {version}\n")
    (folder / "CHANGELOG.md").write_text(changelog)
    return folder


def test_a_release_prints_its_notes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    changelog = "# Changes\n\n## 1.0.0 (2027-01-02)\n\n- new\n\n## 0.9.0 (2026-01-02)\n\n- old\n"
    root = _project(tmp_path, "1.0.0", changelog)
    assert release["main"]("v1.0.0", root) == 0
    assert capsys.readouterr().out == "- new\n"


@pytest.mark.parametrize(
    ("tag", "version", "changelog", "reason"),
    [
        ("v1.0.1", "1.0.0", "## 1.0.0 (2027-01-02)\n", "CITATION.cff must name version 1.0.1"),
        ("v1.0.0", "1.0.0", "## 1.0.0 (unreleased)\n", "CHANGELOG.md must have no unreleased"),
        (
            "v1.0.0",
            "1.0.0",
            "## Unreleased\n\n- new\n\n## 1.0.0 (2027-01-02)\n",
            "CHANGELOG.md must have no unreleased",
        ),
        ("v1.0.0", "1.0.0", "## 0.9.0 (2027-01-02)\n", "CHANGELOG.md, with a date, must name"),
    ],
)
def test_what_is_missing_stops_a_release(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    tag: str,
    version: str,
    changelog: str,
    reason: str,
) -> None:
    assert release["main"](tag, _project(tmp_path, version, changelog)) == 1
    assert reason in capsys.readouterr().err


def test_the_version_is_written_in_one_place() -> None:
    assert 'dynamic = ["version"]' in (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    files = [*(ROOT / "lis_grasp").rglob("*.py"), ROOT / "pyproject.toml"]
    texts = {path: path.read_text(encoding="utf-8") for path in files}
    holders = [path for path, text in texts.items() if f'"{lis_grasp.__version__}"' in text]
    assert holders == [ROOT / "lis_grasp" / "version.py"]


def _workflow() -> dict[object, dict[str, dict[str, object]]]:
    path = ROOT / ".github" / "workflows" / "release.yml"
    return yaml.safe_load(path.read_text(encoding="utf-8"))


def test_the_workflow_installs_on_every_supported_python() -> None:
    pyproject = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    low, high = re.search(r'requires-python = ">=3\.(\d+),<3\.(\d+)"', pyproject).groups()
    job = json.loads(json.dumps(_workflow()["jobs"]["install"]))
    assert job["strategy"]["matrix"]["python"] == [f"3.{n}" for n in range(int(low), int(high))]


def test_commands_of_the_dockerfile_exist() -> None:
    text = (ROOT / "Dockerfile").read_text(encoding="utf-8")
    commands = re.findall(r"^RUN lis-grasp (.+)$", text, re.MULTILINE)
    (served,) = re.findall(r"^CMD (\[.+\])$", text, re.MULTILINE)
    for words in (*map(shlex.split, commands), json.loads(served)):
        build_parser().parse_args(words)
    first = (ROOT / "README.md").read_text(encoding="utf-8")
    assert f"lis-grasp {commands[0]}" in first  # the README's first command
    for source in re.findall(r"^COPY (.+) \S+$", text, re.MULTILINE):
        assert all((ROOT / name).exists() for name in source.split())
    pyproject = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    (packages,) = re.findall(r"^packages = (\[.+\])$", pyproject, re.MULTILINE)
    copied = re.findall(r"^COPY (\S+) \S+$", text, re.MULTILINE)
    assert {*json.loads(packages), "models"} <= {*copied}  # else they are missing, silently


def test_the_source_has_what_is_at_the_root_only() -> None:
    pyproject = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    (included,) = re.findall(r"^include = (\[.+\])$", pyproject, re.MULTILINE)
    for name in json.loads(included):
        assert name.startswith("/")
        assert (ROOT / name[1:]).exists()


@pytest.mark.parametrize("extra", ["--help", "studdy", "dev,de.", "a b; false"])
def test_the_bootstrap_refuses_what_is_no_extra_before_it_installs(extra: str) -> None:
    done = subprocess.run(
        ["bash", ROOT / "bootstrap.sh", extra], capture_output=True, text=True, check=False
    )
    assert done.returncode == 1
    assert re.fullmatch(
        r"bootstrap: there is no extra '\S+'; the extras are .*study.*\n", done.stderr
    )


def test_the_bootstrap_knows_every_supported_python() -> None:
    text = (ROOT / "bootstrap.sh").read_text(encoding="utf-8")
    assert f"{sys.version_info[0]}.{sys.version_info[1]}" in text
