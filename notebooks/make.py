"""Run the notebooks and keep their outputs; start.ipynb is written from docs/start.md first. Run
this after each change.

    python notebooks/make.py [NAME ...]
"""

import re
import sys
import tempfile
from pathlib import Path

import nbformat
from nbclient import NotebookClient

HERE = Path(__file__).parent
PAGE = HERE.parent / "docs" / "start.md"
KERNEL = {"display_name": "Python 3", "language": "python", "name": "python3"}


def cells() -> list[nbformat.NotebookNode]:
    """Text and python blocks of the page; outputs and pictures come from the run."""
    text = re.sub(r"```output\n.*?```\n", "", PAGE.read_text(encoding="utf8"), flags=re.DOTALL)
    text = re.sub(r"!\[.*?\]\(.*?\)\n", "", text)
    text = re.sub(r"\]\((?=\w+\.md)", "](../docs/", text)
    made = []
    for index, part in enumerate(re.split(r"```python\n(.*?)```\n", text, flags=re.DOTALL)):
        part = re.sub(r"\n{3,}", "\n\n", part.strip())
        cell = (nbformat.v4.new_code_cell if index % 2 else nbformat.v4.new_markdown_cell)(part)
        cell["id"] = f"cell-{index}"
        if part:
            made.append(cell)
    return made


def make(path: Path) -> None:
    if path.stem == "start":
        notebook = nbformat.v4.new_notebook(cells=cells())
    else:
        notebook = nbformat.read(path, as_version=4)
    notebook.metadata = {"kernelspec": KERNEL, "language_info": {"name": "python"}}
    with tempfile.TemporaryDirectory() as folder:
        NotebookClient(notebook, timeout=300, resources={"metadata": {"path": folder}}).execute()
    for cell in notebook.cells:
        cell.metadata.clear()  # times of execution
    notebook.metadata = {"kernelspec": KERNEL, "language_info": {"name": "python"}}
    nbformat.write(notebook, path)


def main() -> None:
    for name in sys.argv[1:] or sorted(path.stem for path in HERE.glob("*.ipynb")):
        make(HERE / f"{name}.ipynb")


if __name__ == "__main__":
    main()
