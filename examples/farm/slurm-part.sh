#!/usr/bin/env bash
# Renders one part of a picture: task i of an array of PARTS takes the i-th range of samples.
#   sbatch --array=0-7 --export=ALL,SCENE=scene.glb,SPP=256,PARTS=8 slurm-part.sh
# SCENE, SPP and PARTS are required; FOLDER (default .) keeps the partial films, and OPTIONS are passed on.
#SBATCH --job-name=raystream-part
#SBATCH --cpus-per-task=8
# SIGTERM a minute before the time is over: raystream then writes its checkpoint, from which the same task goes on.
#SBATCH --signal=TERM@60
#SBATCH --requeue
set -euo pipefail

part=$SLURM_ARRAY_TASK_ID
first=$((part * SPP / PARTS))
end=$(((part + 1) * SPP / PARTS))
name=${FOLDER:-.}/part-$part
# shellcheck disable=SC2086 # OPTIONS are several words
exec raystream render "$SCENE" ${OPTIONS:-} --spp "$SPP" --samples "$first..$end" --partial "$name.rayfilm" \
    --checkpoint "$name.ray" --resume --progress plain
