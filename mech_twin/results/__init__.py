# SPDX-License-Identifier: Apache-2.0
"""Results as Python objects, from a run, a file, or the output of a verb."""
