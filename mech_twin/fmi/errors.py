# SPDX-License-Identifier: Apache-2.0
"""Why a machine cannot be exported."""

from mech_twin.capabilities.errors import StudyError


class ExportError(StudyError):
    """One line with the machine or the tool, and what was expected."""
