#!/usr/bin/env bash
# Adds up the parts that slurm-part.sh has rendered.
#   sbatch --dependency=afterok:JOB --export=ALL,OUT=out.exr,PARTS=8 slurm-merge.sh
# OUT and PARTS are required; FOLDER (default .) has the partial films.
#SBATCH --job-name=raystream-merge
set -euo pipefail

parts=()
for ((part = 0; part < PARTS; part++)); do
    parts+=("${FOLDER:-.}/part-$part.rayfilm")
done
exec raystream merge "${parts[@]}" -o "$OUT"
