# SPDX-License-Identifier: Apache-2.0
"""Square linear systems of recorded numbers, solved without a choice of pivots when the source runs.

A fixed order of pivots divides by zero at poses where the matrix is regular.  Here only dead points do:

1. rows and columns are put in block triangular form (by the zeros that are there whatever the arguments are);
2. constants, as of angles that add up, are eliminated;
3. a block of one divides, a block of two is Cramer's rule, a larger one is made orthogonal column by column (modified
   Gram-Schmidt without roots, [bjorck], whose divisors are the squared distances of columns from those before).
"""

from collections.abc import Sequence
from itertools import pairwise

from mech_twin.mechanics.code_generation import Number, is_zero, magnitude, square_root, total

Matrix = list[list[Number]]


def transposed(a: Sequence[Sequence[Number]]) -> Matrix:
    """Return columns as rows."""
    return [list(column) for column in zip(*a, strict=True)]


def solution(a: Matrix, b: Matrix, scales: Sequence[Number] | None = None) -> tuple[Matrix, list[Number]]:
    """Return x of a x = b, and how regular each block is: 1 for orthogonal columns, 0 at a dead point.

    Parameters
    ----------
    a : list of list of Number
        Square, n rows; structurally regular.
    b : list of list of Number
        n rows, one column a right-hand side.
    scales : sequence of Number, optional
        Length of each column of the unreduced matrix; None asks for no measure of regularity.

    Raises
    ------
    ZeroDivisionError
        The zeros alone make the matrix singular.
    """
    n = len(a)
    if n == 0:
        return [], []
    rows = [list(row) for row in b]
    x: list[list[Number]] = [[] for _ in range(n)]
    regularity: list[Number] = []
    known: list[int] = []
    for block_rows, block_columns in _blocks(a):
        part = [[a[i][j] for j in block_columns] for i in block_rows]
        right = [
            [rows[i][m] - total([a[i][j] * x[j][m] for j in known]) for m in range(len(rows[i]))] for i in block_rows
        ]
        sizes = None if scales is None else [scales[j] for j in block_columns]
        found, quality = _block_solution(part, right, sizes)
        regularity += quality
        for j, values in zip(block_columns, found, strict=True):
            x[j] = values
        known += block_columns
    return x, regularity


def _block_solution(a: Matrix, b: Matrix, scales: Sequence[Number] | None) -> tuple[Matrix, list[Number]]:
    """Solve a block that has no triangular form."""
    n = len(a)
    pivot = _constant(a) if n > 1 else None
    if pivot is not None:
        return _eliminated(a, b, scales, *pivot)
    if n == 1:
        inverse = 1.0 / a[0][0]
        constant = isinstance(a[0][0], float)
        quality = [] if scales is None or constant else [magnitude(a[0][0]) / scales[0]]
        return [[inverse * y for y in b[0]]], quality
    if n == 2:
        (p, q), (r, s) = a
        det = p * s - q * r
        inverse = 1.0 / det
        pairs = list(zip(b[0], b[1], strict=True))
        quality = [] if scales is None else [magnitude(det) / (scales[0] * scales[1])]
        return [[(s * y - q * z) * inverse for y, z in pairs], [(p * z - r * y) * inverse for y, z in pairs]], quality
    return _orthogonalised(a, b, scales)


def _eliminated(
    a: Matrix, b: Matrix, scales: Sequence[Number] | None, row: int, column: int
) -> tuple[Matrix, list[Number]]:
    """Solve a block with a constant that serves as a pivot."""
    others = [j for j in range(len(a)) if j != column]
    inverse = 1.0 / a[row][column]
    reduced, right = [], []
    for i in range(len(a)):
        if i == row:
            continue
        factor = a[i][column] * inverse
        reduced.append([a[i][j] - factor * a[row][j] for j in others])
        right.append([y - factor * z for y, z in zip(b[i], b[row], strict=True)])
    found, quality = solution(reduced, right, None if scales is None else [scales[j] for j in others])
    last = [
        (y - total([a[row][j] * found[k][m] for k, j in enumerate(others)])) * inverse for m, y in enumerate(b[row])
    ]
    found.insert(column, last)
    return found, quality


def _orthogonalised(a: Matrix, b: Matrix, scales: Sequence[Number] | None) -> tuple[Matrix, list[Number]]:
    """Solve by columns made orthogonal; each right-hand side is treated like one more column."""
    n = len(a)
    columns: Matrix = []
    inverses: list[Number] = []
    above: Matrix = [[0.0] * n for _ in range(n)]
    quality: list[Number] = []
    for k, start in enumerate(transposed(a)):
        v = start
        for i, u in enumerate(columns):
            above[i][k] = total([x * y for x, y in zip(u, v, strict=True)]) * inverses[i]
            v = [y - above[i][k] * x for x, y in zip(u, v, strict=True)]
        square = total([y * y for y in v])
        columns.append(v)
        inverses.append(1.0 / square)
        if scales is not None:
            quality.append(square_root(square) / scales[k])
    solved = []
    for right in transposed(b):
        rest, x = right, []
        for u, inverse in zip(columns, inverses, strict=True):
            y = total([p * q for p, q in zip(u, rest, strict=True)]) * inverse
            rest = [q - y * p for p, q in zip(u, rest, strict=True)]
            x.append(y)
        for i in range(n - 2, -1, -1):
            x[i] = x[i] - total([above[i][j] * x[j] for j in range(i + 1, n)])
        solved.append(x)
    return transposed(solved) if solved else [[] for _ in range(n)], quality


def _constant(a: Matrix) -> tuple[int, int] | None:
    """Return row and column of the constant that fills in least, largest of its column; None where there is none."""
    best: tuple[int, float, int, int] | None = None
    for j in range(len(a)):
        constants = [(abs(x), i) for i in range(len(a)) if isinstance(x := a[i][j], float) and x != 0.0]
        for size, i in constants:
            if size < max(constants)[0]:
                continue
            in_row = sum(not is_zero(x) for x in a[i])
            in_column = sum(not is_zero(row[j]) for row in a)
            cost = ((in_row - 1) * (in_column - 1), -size, i, j)
            best = cost if best is None else min(best, cost)
    return None if best is None else best[2:]


def _blocks(a: Matrix) -> list[tuple[list[int], list[int]]]:
    """Return rows and columns of the diagonal blocks, each needing only columns of those before it."""
    n = len(a)
    row_of = _matching(a)
    needs = [{k for k in range(n) if not is_zero(a[row_of[j]][k])} for j in range(n)]  # of column j, columns
    for k in range(n):
        for j in range(n):
            if k in needs[j]:
                needs[j] |= needs[k]
    order = sorted(range(n), key=lambda j: (len(needs[j]), sorted(needs[j]), j))  # a block needs the same
    blocks: list[list[int]] = [[order[0]]]
    for before, j in pairwise(order):
        if before in needs[j] and j in needs[before]:
            blocks[-1].append(j)
        else:
            blocks.append([j])
    return [(sorted(row_of[j] for j in block), sorted(block)) for block in blocks]


def _matching(a: Matrix) -> list[int]:
    """Return a row for each column with an entry there that is not zero."""
    n = len(a)
    row_of = [-1] * n
    column_of = [-1] * n

    def augment(j: int, seen: set[int]) -> bool:
        for i in range(n):
            if is_zero(a[i][j]) or i in seen:
                continue
            seen.add(i)
            if column_of[i] < 0 or augment(column_of[i], seen):
                column_of[i], row_of[j] = j, i
                return True
        return False

    if not all(augment(j, set()) for j in range(n)):
        raise ZeroDivisionError("the closures do not determine the dependent joints")
    return row_of
