# SPDX-License-Identifier: Apache-2.0
"""The process: signals and interruption, what it needs of system and packages, where its output goes."""
