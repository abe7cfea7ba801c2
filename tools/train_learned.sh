#!/usr/bin/env bash
# Trains every learned policy of the benchmark, ten seeds a method, and copies what is shipped (weights,
# description, learning curve) to the package.
# Usage: tools/train_learned.sh [DIRECTORY] [METHOD...]     (run from the project root; goes on where it was
#        interrupted: a finished run is not trained again; JOBS=2 trains two at a time; the methods one after
#        another, seed by seed)
set -euo pipefail

runs=${1:-results/benchmark/runs}
shift || true
methods=${*:-dagger ppo ppo_direct ppo_robust ppo_flexible sac sac_direct}
settings=baselines/drm_baselines/benchmark/learners
shipped=baselines/drm_baselines/learned
export OMP_NUM_THREADS=1

one() {
  local method=$1 seed=$2 out=$runs/$1/seed_$2
  [ -f "$out/done" ] && return
  case $method in
    dagger) .venv/bin/drm imitate --out "$out" --seed "$seed" --force ;;
    ppo) .venv/bin/drm train --algo ppo --hyperparameters "$settings/ppo.toml" \
      --env drm_env/SlewResidual-v1 --steps 3000000 --seed "$seed" --out "$out" --force ;;
    sac) .venv/bin/drm train --algo sac --hyperparameters "$settings/sac.toml" \
      --steps 250000 --seed "$seed" --out "$out" --force ;;
    ppo_direct) .venv/bin/drm train --algo ppo --hyperparameters "$settings/ppo_direct.toml" \
      --env drm_env/Slew-v1 --steps 4000000 --seed "$seed" --out "$out" --force ;;
    ppo_flexible) .venv/bin/drm train --algo ppo --hyperparameters "$settings/ppo_flexible.toml" \
      --env drm_env/SlewFlexible-v0 --steps 600000 --seed "$seed" --out "$out" --force ;;
    ppo_robust) .venv/bin/drm train --algo ppo --hyperparameters "$settings/ppo_robust.toml" \
      --env drm_env/Slew-v1 --steps 1500000 --seed "$seed" --out "$out" --force ;;
    sac_direct) .venv/bin/drm train --algo sac --hyperparameters "$settings/sac_direct.toml" \
      --env drm_env/Slew-v0 --steps 250000 --seed "$seed" --out "$out" --force ;;
    *) echo "no method $method" >&2; exit 2 ;;
  esac
  mkdir -p "$shipped/$method/seed_$seed"
  cp "$out"/policy.safetensors "$out"/policy.json "$out"/evaluations.csv "$shipped/$method/seed_$seed/"
  touch "$out/done"
}
export -f one
export runs settings shipped

# what the teacher works out is made once: by the first run, on all cores
case " $methods " in *" dagger "*) one dagger 0 ;; esac

for method in $methods; do
  for seed in 0 1 2 3 4 5 6 7 8 9; do echo "$method $seed"; done
done | xargs -P "${JOBS:-1}" -L 1 bash -c 'set -euo pipefail; one "$1" "$2"' _
