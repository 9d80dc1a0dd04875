# SPDX-License-Identifier: Apache-2.0
"""Step messages between nodes: as objects inside a process, as bytes over DDS, behind one interface."""
