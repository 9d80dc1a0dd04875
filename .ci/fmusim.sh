#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Builds fmusim, the importer of the Modelica Association, from its sources and runs the tests of units with it.
# Needs libxml2-dev, zlib1g-dev, libminizip-dev and libsundials-dev.
# Usage: fmusim.sh VENV_BIN [DIRECTORY with the sources of modelica/Reference-FMUs]
set -euo pipefail
bin=$(cd "$1" && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
source=${2:-$work/source}
[ -d "$source" ] || git -c advice.detachedHead=false clone --quiet --depth 1 --branch v0.0.39 https://github.com/modelica/Reference-FMUs "$source"
mkdir "$work/bin"
# Debian's SUNDIALS has no SUN_COMM_NULL yet; its solvers serve model exchange, of which the units have none
(cd "$source/fmusim" && cc -w -O1 -o "$work/bin/fmusim" -D'FMUSIM_VERSION="0.0.39"' -DSUN_COMM_NULL=NULL -D_GNU_SOURCE \
  -I. -I../include -I/usr/include/libxml2 -I/usr/include/minizip ./*.c ../src/FMI*.c ../src/structured_variable_name.*.c \
  -lxml2 -lz -lminizip -lsundials_cvode -lsundials_sunlinsoldense -lsundials_sunmatrixdense -lsundials_nvecserial -ldl -lm)
PATH="$work/bin:$PATH" "$bin/python" -m pytest -q -p no:cacheprovider test/fmi/test_other_importers.py
