# SPDX-License-Identifier: Apache-2.0
"""A run from its start to its end: in one process or several, named, attended at a terminal, told what to do."""
