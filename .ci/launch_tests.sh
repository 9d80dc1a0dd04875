#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Runs the tests of the launch files with the launch library from its sources: it is pure Python and on no index.
# Usage: launch_tests.sh VENV_BIN [DIRECTORY with clones of ros2/launch and ros2/launch_ros]
set -euo pipefail
bin=$(cd "$1" && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
for source in launch@3.4.3 launch_ros@0.26.6; do # those of Jazzy
  name=${source%@*}
  git -c advice.detachedHead=false clone --quiet --depth 1 --branch "${source#*@}" "${2:-https://github.com/ros2}/$name" "$work/$name"
done
"$bin/python" -m pip install --quiet --no-deps --target "$work/osrf" "osrf-pycommon>=2.0.2"
# an interface package that launch_ros imports for composable nodes, of which our launch files have none
mkdir -p "$work/osrf/composition_interfaces"
printf "class LoadNode:\n    Request = Response = object\n" >"$work/osrf/composition_interfaces/srv.py"
touch "$work/osrf/composition_interfaces/__init__.py"
export PYTHONPATH="$PWD:$work/launch/launch:$work/launch_ros/launch_ros:$work/osrf"
"$bin/python" -m pytest -q -p no:cacheprovider -m "slow or not slow" test/nodes/test_launch.py
