# SPDX-License-Identifier: Apache-2.0
"""One law of contact and one loop: what every machine with impacts, friction and stops is advanced by."""
