# SPDX-License-Identifier: Apache-2.0
"""The bench: one page to watch and to command a machine, served to this machine alone."""
