# SPDX-License-Identifier: Apache-2.0
"""Files read and written: regular, bounded, and whole or not there."""
