"""Execute the notebooks, and store outputs that a page of a code host shows.

    python notebooks/execute.py [NOTEBOOK ...]      (needs the extra `notebooks`)

An interactive page is stored as its picture: such a host runs no scripts, and a page is large.
"""

import re
import sys
import tempfile
from pathlib import Path
from typing import Any

import nbformat
from nbclient import NotebookClient

FOLDER = Path(__file__).parent
LONGEST = 20_000  # characters of a kind of output that is no picture


def stored(output: Any) -> Any:
    """Return an output of a cell without interactive pages, paths of this machine and logs."""
    if output.output_type == "stream":
        text = re.sub(r"^\S*ipykernel_\S+ ", "", output.text, flags=re.MULTILINE)
        output.text = re.sub(r"^INFO:.*\n", "", text, flags=re.MULTILINE)
    if "data" in output:
        data = output.data
        kept = {kind: text for kind, text in data.items() if len(text) <= LONGEST}
        output.data = kept | {kind: data[kind] for kind in ("image/png",) if kind in data}
        if "image/png" in output.data:
            output.data.pop("text/html", None)
    output.pop("metadata", None) if output.output_type == "stream" else output.update(metadata={})
    return output


def execute(path: Path) -> None:
    """Execute a notebook in an empty folder, and write it with its outputs."""
    notebook = nbformat.read(path, as_version=4)
    with tempfile.TemporaryDirectory() as folder:
        resources = {"metadata": {"path": folder}}
        NotebookClient(notebook, timeout=900, resources=resources, record_timing=False).execute()
    for cell in notebook.cells:
        if cell.cell_type == "code":
            printed = [o for o in cell.outputs if o.output_type == "stream"]
            for other in printed[1:]:
                printed[0].text += other.text
            cell.outputs = [stored(o) for o in cell.outputs if o not in printed[1:]]
    notebook.metadata = {
        "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
        "language_info": {"name": "python"},
    }
    nbformat.write(notebook, path)
    print(f"{path.name}: {path.stat().st_size / 1e6:.2f} MB", flush=True)


if __name__ == "__main__":
    for name in sys.argv[1:] or sorted(FOLDER.glob("*.ipynb")):
        execute(Path(name))
