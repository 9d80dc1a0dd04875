# SPDX-License-Identifier: Apache-2.0
"""The notebooks of the documentation, run as a reader would run them: cell by cell in one namespace.

``python test/notebooks.py`` runs them and writes what their cells show into them.
"""

from __future__ import annotations

import ast
import json
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "notebooks"


def code_cells(notebook: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the cells that hold code, in order."""
    return [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]


def shown(source: str, namespace: dict[str, Any]) -> str:
    """Run a cell; return what its last line shows if it is an expression."""
    tree = ast.parse(source)
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    exec(compile(tree, "cell", "exec"), namespace)
    if last is None:
        return ""
    value = eval(compile(ast.Expression(last.value), "cell", "eval"), namespace)
    return "" if value is None else repr(value)


def stored(cell: dict[str, Any]) -> str:
    """Return what a cell showed when the notebook was written."""
    return "".join(text for output in cell["outputs"] for text in output["data"]["text/plain"])


def write(path: Path) -> None:
    """Run a notebook and write what its cells show into it."""
    notebook = json.loads(path.read_text(encoding="utf-8"))
    namespace: dict[str, Any] = {}
    for number, cell in enumerate(code_cells(notebook), 1):
        text = shown("".join(cell["source"]), namespace)
        data = {"text/plain": text.splitlines(keepends=True)}
        output = {"output_type": "execute_result", "execution_count": number, "metadata": {}, "data": data}
        cell["outputs"] = [output] if text else []
        cell["execution_count"] = number
    path.write_text(json.dumps(notebook, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


if __name__ == "__main__":
    for file in sorted(FOLDER.glob("*.ipynb")):
        write(file)
