#!/usr/bin/env bash
# Runs many data sets as a SLURM array job. Each task identifies one shard of the data sets with a
# Snakemake of its own. When all tasks have ended, one run writes the lists of all data sets.
#
#   PATH/profiles/slurm/array_job.sh TASKS [option of sbatch ...]      in the folder of config.yaml
#
# Run again, it continues where it was stopped. Nothing else may run in the folder meanwhile.
set -euo pipefail

if [[ ! ${1:-} =~ ^[1-9][0-9]*$ ]]; then
    sed -n '2,8s/^# \{0,1\}//p' "$0"
    exit 2
fi
tasks=$1
shift

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
printf -v run 'snakemake --snakefile %q --workflow-profile %q' "$root/Snakefile" "$root/profiles/default"
logs=.snakemake/array_job
mkdir -p "$logs"

# Tasks never write the same file, so a lock would only remain behind one that is cancelled.
array=$(sbatch --parsable --job-name=evopem-shards --array="1-$tasks" --output="$logs/%A-%a.log" \
    --requeue "$@" --wrap "$run --nolock --cores \${SLURM_CPUS_PER_TASK:-1} \
    --config shard=\$SLURM_ARRAY_TASK_ID/$tasks")
array=${array%%;*}
last=$(sbatch --parsable --job-name=evopem-lists --dependency="afterany:$array" \
    --output="$logs/%A.log" "$@" --wrap "$run --nolock --cores \${SLURM_CPUS_PER_TASK:-1}")
echo "Array $array, then ${last%%;*}; logs in $logs. Stop both: scancel $array ${last%%;*}"
