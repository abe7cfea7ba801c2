"""Prints the resident memory of a process that holds a batch: run by the section ``memory``.

python -m drm_baselines.speed.memory_probe NUM_ENVS STEPS

One JSON object: bytes before the batch, after its reset, after a tenth of STEPS environment steps
and after all of them.
"""

from __future__ import annotations

import gc
import json
import sys

import psutil

import drm_env
from drm_baselines.speed.sections.vector import batch_stepper


def resident() -> int:
    """Return the resident memory of this process, bytes."""
    gc.collect()
    return int(psutil.Process().memory_info().rss)


def probe(num_envs: int, steps: int) -> dict[str, int]:
    """Return the resident memory along the life of a batch, bytes."""
    # What is loaded at the first use of a batch must not count as one's memory.
    first = drm_env.DrmVectorEnv(1)
    batch_stepper(first)()
    first.close()
    before = resident()
    batch = drm_env.DrmVectorEnv(num_envs)
    step = batch_stepper(batch)
    after_reset = resident()
    calls = -(-steps // num_envs)
    early = after_reset
    for call in range(calls):
        step()
        if call == calls // 10:
            early = resident()
    late = resident() if calls else early
    batch.close()
    return {"before": before, "after_reset": after_reset, "early": early, "late": late}


if __name__ == "__main__":
    print(json.dumps(probe(int(sys.argv[1]), int(sys.argv[2]))))
