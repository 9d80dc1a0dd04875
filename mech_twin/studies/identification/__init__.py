# SPDX-License-Identifier: Apache-2.0
"""Parameters of a machine from measured runs: fits, intervals, verdicts, and which sensors would find what."""
