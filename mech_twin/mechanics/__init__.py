# SPDX-License-Identifier: Apache-2.0
"""Planar structures of bodies and joints, written out as straight-line kernels by one formulation run on symbols."""
