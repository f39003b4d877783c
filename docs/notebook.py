"""Runs `examples/story.ipynb` and keeps its outputs in it: `make notebook`."""

from pathlib import Path
from typing import Any

ROOT = Path(__file__).parent.parent
NOTEBOOK = ROOT / "examples" / "story.ipynb"


def read() -> Any:
    """The notebook as it is kept."""
    import nbformat

    return nbformat.read(NOTEBOOK, as_version=4)


def run() -> Any:
    """The notebook run anew, without times and what this machine warned of."""
    import nbclient

    notebook = read()
    nbclient.NotebookClient(notebook, timeout=300, kernel_name="python3",
                            resources={"metadata": {"path": str(ROOT)}}).execute()
    for cell in notebook.cells:
        cell.metadata.pop("execution", None)
        if cell.cell_type == "code":
            cell.outputs = [o for o in cell.outputs if o.get("name") not in ("stderr", "stdout")]
    notebook.metadata["language_info"] = {"name": "python"}
    return notebook


def texts(notebook: Any) -> list[str]:
    """What each output says in plain text, but for the addresses of objects."""
    return [output["data"]["text/plain"].partition(" at 0x")[0] for cell in notebook.cells
            for output in cell.get("outputs", ()) if "text/plain" in output.get("data", {})]


if __name__ == "__main__":
    import nbformat

    nbformat.write(run(), NOTEBOOK)
