#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Builds and tests the package with colcon, away from the source tree, and uses what was installed.
# Usage: colcon_build.sh VENV_BIN
set -euo pipefail
bin=$(cd "$1" && pwd)
source_tree=$(cd "$(dirname "$0")/../.." && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
export PATH="$bin:$PATH" ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST ROS_DOMAIN_ID=59
export COLCON_LOG_PATH="$work/log"

mkdir -p "$work/src"
git -C "$source_tree" ls-files -z | tar -C "$source_tree" --null -T - -cf - | (mkdir "$work/src/mech_twin" && tar -C "$work/src/mech_twin" -xf -)
cd "$work"
colcon build --base-paths src --event-handlers console_cohesion-
colcon test --base-paths src --event-handlers console_cohesion- --pytest-args -p no:cacheprovider test/messages test/parameters -m "not slow"
colcon test-result --verbose

prefix="$work/install/mech_twin"
test -x "$prefix/lib/mech_twin/linkage_node"
test -x "$prefix/lib/mech_twin/mech-twin"
test -f "$prefix/share/mech_twin/config/mb10_breaker.yaml"
test -f "$prefix/share/mech_twin/launch/twin.launch.py"
test -f "$prefix/share/mech_twin/rviz/mb10_breaker.rviz"
test -f "$prefix/share/mech_twin/foxglove/mb10_breaker.json"
test -f "$prefix/share/ament_index/resource_index/packages/mech_twin"

# The installed command finds the installed configuration, with the source tree out of reach.
mv src gone
site=$(echo "$prefix"/lib/python3*/site-packages)
cd /
PYTHONPATH="$site" "$prefix/lib/mech_twin/mech-twin" list
PYTHONPATH="$site" AMENT_PREFIX_PATH="$prefix" "$prefix/lib/mech_twin/mech-twin" simulate winding_drum --duration 0.1 --json |
  python -c "import json, sys; assert json.load(sys.stdin)['machine'] == 'winding_drum'"
echo "colcon: built, tested, used"
