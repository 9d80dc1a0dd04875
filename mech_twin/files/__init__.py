# SPDX-License-Identifier: Apache-2.0
"""Reading and writing of files: regular files only, bounded input, atomic output."""
