# SPDX-License-Identifier: Apache-2.0
from mech_twin.api import analyse as analyse
from mech_twin.api import compare as compare
from mech_twin.api import from_json as from_json
from mech_twin.api import identify as identify
from mech_twin.api import machine_names as machine_names
from mech_twin.api import reproduce as reproduce
from mech_twin.api import search as search
from mech_twin.api import simulate as simulate
from mech_twin.api import size as size
from mech_twin.api import sweep as sweep
from mech_twin.studies.named_rollouts import rollout as rollout
from mech_twin.studies.named_rollouts import rollouts as rollouts

__version__: str
