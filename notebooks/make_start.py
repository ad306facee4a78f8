"""Write start.ipynb from docs/start.md, and run it. Run this after each change of the page.

    python notebooks/make_start.py
"""

import re
import tempfile
from pathlib import Path

import nbformat
from nbclient import NotebookClient

HERE = Path(__file__).parent
PAGE = HERE.parent / "docs" / "start.md"


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


def main() -> None:
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    metadata = {"kernelspec": kernel, "language_info": {"name": "python"}}
    notebook = nbformat.v4.new_notebook(cells=cells(), metadata=metadata)
    with tempfile.TemporaryDirectory() as folder:
        NotebookClient(notebook, timeout=120, resources={"metadata": {"path": folder}}).execute()
    for cell in notebook.cells:
        cell.metadata.clear()  # times of execution
    notebook.metadata = metadata
    nbformat.write(notebook, HERE / "start.ipynb")


if __name__ == "__main__":
    main()
