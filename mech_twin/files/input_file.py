# SPDX-License-Identifier: Apache-2.0
"""Input files: regular files only, so that a command cannot block on a pipe without a writer.

Untrusted YAML is read with bounds on its size and on the expansion of its aliases.
"""

import errno
import os
import stat
from pathlib import Path
from typing import Any, BinaryIO

import yaml

TABLE_SUFFIXES = (".csv", ".tsv", ".txt", ".parquet")
MAX_TEXT_BYTES = 1 << 20
MAX_NODES = 200_000
_LOADER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class UnboundedYamlError(ValueError):
    """The text, or the expansion of its aliases, is larger than allowed."""


def bounded_yaml(text: str | bytes) -> Any:
    """Return a YAML document as plain dictionaries, lists and scalars.

    Raises
    ------
    yaml.YAMLError, ValueError, RecursionError
        The text is not YAML, is too large, or refers to itself.
    """
    if len(text) > MAX_TEXT_BYTES:
        raise UnboundedYamlError(f"larger than {MAX_TEXT_BYTES} bytes")
    loader = _LOADER(text)
    try:
        node = loader.get_single_node()
        if node is None:
            return None
        _expanded_nodes(node, {})
        return loader.construct_document(node)
    finally:
        loader.dispose()


def _expanded_nodes(node: yaml.Node, known: dict[int, int]) -> int:
    """Return the number of nodes of a node after expansion of its aliases."""
    count = known.get(id(node))
    if count == 0:
        raise UnboundedYamlError("an alias refers to what contains it")
    if count is None:
        known[id(node)] = 0
        count = 1
        if isinstance(node, yaml.SequenceNode):
            count += sum(_expanded_nodes(child, known) for child in node.value)
        elif isinstance(node, yaml.MappingNode):
            count += sum(_expanded_nodes(child, known) for pair in node.value for child in pair)
        if count > MAX_NODES:
            raise UnboundedYamlError(f"its aliases expand to more than {MAX_NODES} nodes")
        known[id(node)] = count
    return count


def opened_input(path: Path) -> BinaryIO:
    """Return a regular file, opened for reading bytes.

    Raises
    ------
    OSError
        If it cannot be opened, or is a pipe, a device or a directory.
    """
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)  # a pipe opens at once, then is refused
    try:
        mode = os.fstat(descriptor).st_mode
        if stat.S_ISDIR(mode):
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
        if not stat.S_ISREG(mode):
            raise OSError(errno.EINVAL, "it is not a regular file", str(path))
    except OSError:
        os.close(descriptor)
        raise
    return os.fdopen(descriptor, "rb")
