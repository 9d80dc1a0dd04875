# SPDX-License-Identifier: Apache-2.0
"""What stands as published is a number that was printed: read in the source text, where it is a literal."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import mech_twin.machines

FILES = sorted(Path(mech_twin.machines.__file__).parent.glob("*/published.py"))
ROWS = ("gated", "limit", "reported")
TOGETHER = ("zip", "items")  # calls that only arrange what they are given


class Literals(ast.NodeVisitor):
    """The names that hold literals in a module, and the rows whose published value is none."""

    def __init__(self, module: ast.Module) -> None:
        self.names = {
            target.id
            for node in module.body
            if isinstance(node, ast.Assign) and is_plain(node.value)
            for target in node.targets
            if isinstance(target, ast.Name)
        }
        self.rows, self.others = 0, list[str]()
        for node in module.body:
            if isinstance(node, ast.ImportFrom):
                self._import(node)
        self.visit(module)

    def _import(self, node: ast.ImportFrom) -> None:
        own = Path(mech_twin.__file__).parents[1] / f"{str(node.module).replace('.', '/')}.py"
        if own.is_file():
            for each in ast.parse(own.read_text(encoding="utf-8")).body:
                if isinstance(each, ast.Assign) and is_plain(each.value):
                    self.names |= {t.id for t in each.targets if isinstance(t, ast.Name)} & {a.name for a in node.names}

    def holds(self, node: ast.AST) -> bool:
        """Return whether an expression is made of literals alone."""
        if isinstance(node, ast.Call):
            arranged = getattr(node.func, "id", getattr(node.func, "attr", "")) in TOGETHER
            inside = [*node.args, *([node.func.value] if isinstance(node.func, ast.Attribute) else [])]
            return arranged and all(self.holds(each) for each in inside)
        if isinstance(node, ast.Name):
            return node.id in self.names
        return not isinstance(node, ast.Attribute | ast.Await) and all(
            self.holds(each) for each in ast.iter_child_nodes(node) if isinstance(each, ast.expr)
        )

    def bind(self, target: ast.AST, value: ast.AST) -> None:
        """Take note of what an assignment or a loop gives to names: literals, or what is none."""
        named = {node.id for node in ast.walk(target) if isinstance(node, ast.Name)}
        if isinstance(value, ast.Call) and getattr(value.func, "id", "") == "zip" and isinstance(target, ast.Tuple):
            for one, given in zip(target.elts, value.args, strict=True):
                self.bind(one, given)
        elif self.holds(value):
            self.names |= named
        else:
            self._bind_columns(target, value, named)

    def _bind_columns(self, target: ast.AST, value: ast.AST, named: set[str]) -> None:
        """Take note of the columns that are literals, of rows that are written out."""
        self.names -= named
        if isinstance(value, ast.Tuple) and isinstance(target, ast.Tuple):
            rows = [row.elts for row in value.elts if isinstance(row, ast.Tuple)]
            for place, one in enumerate(target.elts):
                if isinstance(one, ast.Name) and rows and all(self.holds(row[place]) for row in rows):
                    self.names.add(one.id)

    def visit_Assign(self, node: ast.Assign) -> None:
        self.generic_visit(node)
        for target in node.targets:
            self.bind(target, node.value)

    def visit_For(self, node: ast.For) -> None:
        self.bind(node.target, node.iter)
        self.generic_visit(node)

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        before = set(self.names)
        self.names -= {each.arg for each in node.args.args}
        self.generic_visit(node)
        self.names = before

    def visit_Call(self, node: ast.Call) -> None:
        if isinstance(node.func, ast.Attribute) and node.func.attr in ROWS:
            self.rows += 1
            if not self.holds(node.args[1]):
                self.others.append(f"line {node.lineno}: {ast.unparse(node.args[1])}")
        self.generic_visit(node)


def is_plain(node: ast.AST) -> bool:
    try:
        ast.literal_eval(node)
    except ValueError:
        return False
    return True


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.parent.name)
def test_what_stands_as_published_is_a_literal_or_called_a_printed_formula(file: Path) -> None:
    found = Literals(ast.parse(file.read_text(encoding="utf-8")))
    assert found.rows > 0
    assert found.others == []


@pytest.mark.parametrize(
    "computed",
    [
        "def rows(p):\n    yield paper.gated('x', p.mass, 1.0, 'why')",
        "def rows(p):\n    mass = p.mass\n    yield paper.limit('x', mass, 1.0, 'why', 'below')",
        "def rows(p):\n    for a, v in (('a', 1.0), ('b', found(p))):\n        yield paper.gated(a, v, 1.0, 'why')",
        "A = 1.0\ndef rows(p):\n    A = f(p)\n    yield paper.reported('x', A, 1.0, DIFFERS, 'why')",
    ],
)
def test_a_row_that_compares_what_is_computed_with_itself_is_found(computed: str) -> None:
    assert len(Literals(ast.parse(computed)).others) == 1
