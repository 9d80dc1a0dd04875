# SPDX-License-Identifier: Apache-2.0
"""Declaration of parameters: configuration trees, quantities with unit and bounds, captions."""
