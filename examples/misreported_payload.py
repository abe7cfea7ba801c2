"""What a wrongly reported mass costs each law, over random manoeuvres and payloads."""

import argparse

import numpy as np

import drm_env

options = argparse.ArgumentParser(description=__doc__)
options.add_argument("--episodes", type=int, default=200)
given = options.parse_args()

print("tip error RMS (mm), median over the episodes")
print("mass reported      none    linear  lyapunov")
for error in (-0.15, -0.05, 0.0, 0.05, 0.15):
    # The same payloads and manoeuvres in every row: a parameter that is fixed moves no other draw.
    scenarios = drm_env.sample_scenarios(
        "slew",
        seed=0,
        n=given.episodes,
        payload_mass=drm_env.LogUniform(50.0, 500.0),
        slew_angle=(np.radians(20.0), np.radians(90.0)),
        slew_profile=["min_time", "min_energy"],
        mass_error=error,
    )
    row = [
        1e3 * np.median(drm_env.rollout(scenarios, law=law)["tip_error_rms"])
        for law in ("none", "linear", "lyapunov")
    ]
    print(f"{error:>+13.0%}" + "".join(f"{value:10.1f}" for value in row))
