#!/bin/bash
# SPDX-License-Identifier: GPL-3.0-or-later
#SBATCH --job-name=imprint-bake
#SBATCH --ntasks=1
#SBATCH --requeue
#SBATCH --open-mode=append

# Bakes a part of a job file of Imprint. As tasks 1 to N of an array, these are all parts:
#
#   sbatch --array=1-16 bake_array.sh JOBS [OPTION ...]
#
# SHARDS is the number of parts, where that is not the number of tasks: SHARDS=16 sbatch --array=3,7 bake_array.sh JOBS does
# two of 16 again. IMPRINT_COMMAND starts Imprint; with a checkout it is "python3 /PATH/TO/scripts/imprint.py bake".
# IMPRINT_REPORTS is the folder for reports and logs.
set -u
jobs=$1
shift
shards=${SHARDS:-$SLURM_ARRAY_TASK_COUNT}
reports=${IMPRINT_REPORTS:-${jobs%.*}-reports}
eval "command=(${IMPRINT_COMMAND:-blender --background --command imprint})"
case " $* " in *" --force "*) ;; *) set -- --resume "$@" ;; esac

srun --ntasks=1 --kill-on-bad-exit=0 "${command[@]}" --jobs "$jobs" --shard "$SLURM_ARRAY_TASK_ID/$shards" \
  --report "$reports/report.$SLURM_ARRAY_TASK_ID.json" --log "$reports/logs" "$@"
code=$?
# 3: this machine has no GPU or too little memory. Others may have it.
if [ $code -eq 3 ] && [ "${SLURM_RESTART_COUNT:-0}" -lt 3 ]; then
  scontrol requeue "${SLURM_ARRAY_JOB_ID}_$SLURM_ARRAY_TASK_ID"
fi
exit $code
