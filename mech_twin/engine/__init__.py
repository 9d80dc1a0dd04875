# SPDX-License-Identifier: Apache-2.0
"""Time: the coupling scheme and the one-process run."""
