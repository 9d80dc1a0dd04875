# SPDX-License-Identifier: Apache-2.0
"""The bench: a web page to watch and command a machine, served to this computer by default."""
