# SPDX-License-Identifier: Apache-2.0
"""What a real machine gives: maps, foreign recordings and tables, data quality, sensors."""
