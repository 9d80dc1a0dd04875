#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Builds the messages of tf2_msgs from its sources with the generators of the wheels, and runs the tests of /tf with them.
# Needs gcc and g++.
# Usage: tf_tests.sh VENV_BIN [DIRECTORY with a clone of ros2/geometry2]
set -euo pipefail
shopt -s nullglob
bin=$(cd "$1" && pwd)
prefix=$(dirname "$bin")
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
git -c advice.detachedHead=false clone --quiet --depth 1 --branch 0.36.4 "${2:-https://github.com/ros2}/geometry2" "$work/source" # that of Jazzy
made=$work/made/tf2_msgs
mkdir -p "$made" "$work/lib"
# each generator by itself: the command `rosidl` finds the entry points of the wheels twice
(cd "$work/source/tf2_msgs" && AMENT_PREFIX_PATH=$prefix "$bin/python" - "$made" "$prefix/share" >"$work/log" 2>&1) <<'PYTHON' || { cat "$work/log"; exit 1; }
import sys
from pathlib import Path
from rosidl_generator_c.cli import GenerateC
from rosidl_generator_py.cli import GeneratePython
from rosidl_typesupport_c.cli import GenerateCTypesupport
from rosidl_typesupport_fastrtps_c.cli import GenerateFastRTPSCTypesupport
from rosidl_typesupport_introspection_c.cli import GenerateIntrospectionCTypesupport
made, share = sys.argv[1:]
for name, generator in {
    "generator_c": GenerateC, "typesupport_c": GenerateCTypesupport, "generator_py": GeneratePython,
    "typesupport_fastrtps_c": GenerateFastRTPSCTypesupport, "typesupport_introspection_c": GenerateIntrospectionCTypesupport,
}.items():
    generator(name).generate("tf2_msgs", ["msg/TFMessage.msg"], [share], Path(made, name))
PYTHON
headers() { "$bin/python" -c "import sysconfig, numpy; print($1)"; }
includes=(-I"$prefix/include" -I"$(headers "sysconfig.get_path('include')")" -I"$(headers "numpy.get_include()")")
for directory in "$prefix"/include/*/; do includes+=(-I"$directory"); done
mkdir -p "$work/include/tf2_msgs"
for part in generator_c typesupport_fastrtps_c typesupport_introspection_c; do
  cp -r "$made/$part/msg" "$work/include/tf2_msgs"
done
built() { # OUTPUT SOURCE...; symbols of the other libraries are found when they are loaded together
  g++ -shared -fPIC -w -O1 -I"$work/include" "${includes[@]}" -o "$@" -L"$work/lib" -L"$prefix/lib" -Wl,-rpath,"$work/lib"
}
compiled() { # SOURCE...: each as the language of its name
  for file in "$@"; do
    case $file in *.c) cc=gcc ;; *) cc="g++ -std=c++17" ;; esac
    $cc -c -fPIC -w -O1 -I"$work/include" "${includes[@]}" -o "$file.o" "$file"
    echo "$file.o"
  done
}
libraries=("$prefix"/lib/libgeometry_msgs__rosidl_*_c.so "$prefix"/lib/libgeometry_msgs__rosidl_generator_py.so "$prefix"/lib/librosidl_*_c.so "$prefix"/lib/librcutils.so "$prefix"/lib/libfastcdr.so*)
for part in generator_c typesupport_introspection_c typesupport_fastrtps_c typesupport_c; do
  mapfile -t objects < <(compiled $(find "$made/$part" -name '*.c' -o -name '*.cpp'))
  built "$work/lib/libtf2_msgs__rosidl_$part.so" "${objects[@]}" "$work"/lib/*.so "${libraries[@]}"
done
mkdir "$work/python"
cp -r "$made/generator_py" "$work/python/tf2_msgs"
touch "$work/python/tf2_msgs/__init__.py"
mapfile -t objects < <(compiled "$work"/python/tf2_msgs/msg/*.c)
built "$work/lib/libtf2_msgs__rosidl_generator_py.so" "${objects[@]}" "$work"/lib/*_c.so "${libraries[@]}"
for file in "$work"/python/tf2_msgs/*.c; do
  part=${file##*.ep.} part=${part%.c}
  mapfile -t objects < <(compiled "$file")
  built "$work/python/tf2_msgs/tf2_msgs_s__$part.so" "${objects[@]}" "$work"/lib/*.so "${libraries[@]}"
done
export PYTHONPATH="$PWD:$work/python" LD_LIBRARY_PATH="$work/lib${LD_LIBRARY_PATH:+:$LD_LIBRARY_PATH}"
"$bin/python" -m pytest -q -p no:cacheprovider -m "slow or not slow" test/nodes/test_frames_node.py
