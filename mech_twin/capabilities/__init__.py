# SPDX-License-Identifier: Apache-2.0
"""Optional capabilities of a machine besides running: types for published values, sizes, designs and plots."""
