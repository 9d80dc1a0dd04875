# SPDX-License-Identifier: Apache-2.0
"""The process: signals and interruption, requirements on system and packages, terminal output."""
