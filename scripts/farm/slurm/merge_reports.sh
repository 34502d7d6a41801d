#!/bin/bash
# SPDX-License-Identifier: GPL-3.0-or-later
#SBATCH --job-name=imprint-merge
#SBATCH --ntasks=1

# Merges the reports of all parts of a job file. SHARDS, IMPRINT_COMMAND and IMPRINT_REPORTS are those of bake_array.sh.
#
#   sbatch merge_reports.sh JOBS
set -u
reports=${IMPRINT_REPORTS:-${1%.*}-reports}
eval "command=(${IMPRINT_COMMAND:-blender --background --command imprint})"
parts=()
for ((shard = 1; shard <= SHARDS; shard++)); do parts+=("$reports/report.$shard.json"); done
exec "${command[@]}" report --merge "$reports/report.json" --sheet "$reports/report.html" "${parts[@]}"
