"""Notebooks as a code host shows them: with pictures, small, and alike on every machine."""

import ast
import json
from base64 import b64decode
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

NOTEBOOKS = sorted((Path(__file__).parent.parent / "notebooks").glob("*.ipynb"))
LARGEST = 1_500_000  # bytes: what code hosts draw without asking
LONGEST = 20_000  # characters of an output that is no picture


def _cells(path: Path, kind: str) -> list[dict[str, Any]]:
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    return [cell for cell in cells if cell["cell_type"] == kind]


def _text(lines: str | list[str]) -> str:
    return lines if isinstance(lines, str) else "".join(lines)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem[:2])
def test_a_notebook_is_stored_as_it_ran_and_with_pictures(path: Path) -> None:
    cells = _cells(path, "code")
    assert [cell["execution_count"] for cell in cells] == [*range(1, len(cells) + 1)]
    outputs = [output for cell in cells for output in cell["outputs"]]
    assert not [output for output in outputs if output["output_type"] == "error"]
    pictures = [
        output["data"]["image/png"]
        for output in outputs
        if "data" in output and "image/png" in output["data"]
    ]
    for picture in pictures:
        pixels = np.asarray(Image.open(BytesIO(b64decode(_text(picture)))).convert("L"))
        assert pixels.std() > 1.0  # something is drawn
    assert pictures
    printing = [
        cell
        for cell in cells
        if "print(" in _text(cell["source"]) and "def " not in _text(cell["source"])
    ]
    assert all(cell["outputs"] for cell in printing)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem[:2])
def test_a_notebook_is_small_and_of_no_machine(path: Path) -> None:
    assert path.stat().st_size < LARGEST
    for cell in _cells(path, "code"):
        for output in cell["outputs"]:
            texts = [_text(output.get("text", ""))]
            texts += [
                _text(text) for kind, text in output.get("data", {}).items() if kind != "image/png"
            ]
            for text in texts:
                assert len(text) <= LONGEST
                assert not [
                    place
                    for place in (
                        "/home/",
                        "/root/",
                        "/tmp/",
                        "/Users/",
                        "<iframe",
                        "object at 0x",
                    )
                    if place in text
                ]


def test_notebooks_begin_with_one_cell_that_installs_what_is_missing() -> None:
    (first,) = {_text(_cells(path, "code")[0]["source"]) for path in NOTEBOOKS}
    condition = first.split("#")[0].rstrip() + "\n    missing = True"
    names = {"missing": False}
    exec(compile(ast.parse(condition), "cell", "exec"), names)
    assert not names["missing"]  # installed here, so that nothing is done
    assert "%pip install" in first


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem[:2])
def test_a_notebook_asks_its_reader_a_question(path: Path) -> None:
    texts = [_text(cell["source"]) for cell in _cells(path, "markdown")]
    (asked,) = [text for text in texts if "**Your turn.**" in text]
    assert "?" in asked.split("**Your turn.**")[1]
