"""One episode of the arm, step by step."""

import gymnasium as gym

import drm_env

env = gym.make("drm_env/Slew-v0", payload_mass=(50.0, 500.0), mass_error=(-0.15, 0.15))
observation, info = env.reset(seed=1)
print(f"the payload weighs {info['context/payload_mass']:.0f} kg", end=", ")
print(f"reported are {info['context/reported_payload_mass']:.0f} kg")

# Both wheels at rest: the arm slews open loop, as its motor was told beforehand.
total, ended = 0.0, False
while not ended:
    action = 0.0 * env.action_space.sample()
    observation, reward, terminated, truncated, info = env.step(action)
    total += float(reward)
    ended = terminated or truncated

print(f"return {total:.2f}")
for name in ("tip_error_rms", "residual_rms", "final_slew_error"):
    unit = next(entry.unit for entry in drm_env.episode_metrics() if entry.name == name)
    print(f"{name:>17}: {info[f'metrics/{name}']:.4f} {unit}")
