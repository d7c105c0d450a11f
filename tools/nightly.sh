#!/usr/bin/env bash
# One night of sumo-eval for cron, systemd and continuous integration: a log beside the history, and the exit status of
# `sumo-eval nightly` (0 good, 1 a gate failed, 2 not begun or not finished, 3 some cases could not be evaluated).
#
#   tools/nightly.sh EVALUATION.toml HISTORY [more options of sumo-eval nightly]
#
# SUMO_EVAL names the program where it is not on PATH, e.g. /opt/sumo_eval/.venv/bin/sumo-eval.
set -euo pipefail

if [ "$#" -lt 2 ]; then
  echo "usage: $0 EVALUATION.toml HISTORY [options of sumo-eval nightly]" >&2
  exit 2
fi
evaluation=$1
history=$2
shift 2

mkdir -p "$history/logs"
log="$history/logs/$(date -u +%Y-%m-%dT%H-%M-%SZ)-$$.log"
status=0
"${SUMO_EVAL:-sumo-eval}" nightly "$evaluation" --history "$history" "$@" >"$log" 2>&1 || status=$?

# Logs are small; those of the last 60 days stay.
find "$history/logs" -name '*.log' -mtime +60 -delete

# A good night is silent, so that cron sends no mail; any other night says everything.
if [ "$status" -eq 0 ]; then
  if [ -t 1 ]; then cat "$log"; fi
else
  cat "$log" >&2
  echo "nightly: exit status $status, log $log" >&2
fi
exit "$status"
