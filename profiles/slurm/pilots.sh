#!/usr/bin/env bash
# Runs many data sets as a SLURM array: each task takes a share of them with a Snakemake of its own, and
# when all have ended, one plain run makes the lists of all.
#
#   PATH/profiles/slurm/pilots.sh TASKS [option of sbatch ...]      in the folder of config.yaml
#
# Run again, it goes on where it was stopped. Nothing else may run in the folder meanwhile.
set -euo pipefail

if [[ ! ${1:-} =~ ^[1-9][0-9]*$ ]]; then
    sed -n 's/^# \{0,1\}//p' "$0"
    exit 2
fi
tasks=$1
shift

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
printf -v run 'snakemake --snakefile %q --workflow-profile %q' "$root/Snakefile" "$root/profiles/default"
logs=.snakemake/pilots
mkdir -p "$logs"

# The tasks' files are never the same, so a lock would only be left behind by one that is cancelled.
array=$(sbatch --parsable --job-name=evopem-pilots --array="1-$tasks" --output="$logs/%A-%a.log" \
    --requeue "$@" --wrap "$run --nolock --cores \${SLURM_CPUS_PER_TASK:-1} \
    --config share=\$SLURM_ARRAY_TASK_ID/$tasks")
array=${array%%;*}
last=$(sbatch --parsable --job-name=evopem-lists --dependency="afterany:$array" \
    --output="$logs/%A.log" "$@" --wrap "$run --nolock --cores \${SLURM_CPUS_PER_TASK:-1}")
echo "Array $array, then ${last%%;*}; logs in $logs. Stop both: scancel $array ${last%%;*}"
