# SPDX-License-Identifier: Apache-2.0
"""A node for each role, and the nodes that record and show their messages."""
