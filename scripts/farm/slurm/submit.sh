#!/bin/bash
# SPDX-License-Identifier: GPL-3.0-or-later

# Sends a job file of Imprint to Slurm: an array of N tasks that bake a part each, and a job that merges their reports.
#
#   submit.sh JOBS N [OPTION ...]
#
# Options are those of a bake, such as --size 4096. The environment variables are those of bake_array.sh.
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
jobs=$(realpath "$1")
export SHARDS=$2
shift 2
array=$(sbatch --parsable --array="1-$SHARDS" "$here/bake_array.sh" "$jobs" "$@")
merge=$(sbatch --parsable --dependency="afterany:${array%%;*}" "$here/merge_reports.sh" "$jobs")
echo "array ${array%%;*}, merge ${merge%%;*}"
