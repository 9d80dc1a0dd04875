# SPDX-License-Identifier: Apache-2.0
"""Compiled kernels: the decorator, and the cache that is keyed by content."""
