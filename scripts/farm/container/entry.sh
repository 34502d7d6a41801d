#!/bin/sh
# SPDX-License-Identifier: GPL-3.0-or-later

# Bakes with the given options. If the container is one of SHARDS, it bakes its part. Its number, from 0, is JOB_COMPLETION_INDEX,
# which indexed Jobs of Kubernetes set, or AWS_BATCH_JOB_ARRAY_INDEX. REPORTS is the folder for reports and logs.
# With the word "merge" alone, it merges the reports of all SHARDS.
set -eu
index=${JOB_COMPLETION_INDEX:-${AWS_BATCH_JOB_ARRAY_INDEX:-}}
if [ "$*" = merge ]; then
  set -- report --merge "$REPORTS/report.json" --sheet "$REPORTS/report.html"
  shard=1
  while [ "$shard" -le "$SHARDS" ]; do
    set -- "$@" "$REPORTS/report.$shard.json"
    shard=$((shard + 1))
  done
elif [ -n "${SHARDS:-}" ] && [ -n "$index" ]; then
  shard=$((index + 1))
  case " $* " in *" --force "*) ;; *) set -- --resume "$@" ;; esac
  set -- --shard "$shard/$SHARDS" --report "$REPORTS/report.$shard.json" --log "$REPORTS/logs" "$@"
fi
exec python3 /opt/imprint/scripts/imprint.py bake "$@"
