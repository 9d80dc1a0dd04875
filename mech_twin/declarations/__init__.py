# SPDX-License-Identifier: Apache-2.0
"""How numbers are declared: configuration trees, quantities with unit and bounds, captions."""
