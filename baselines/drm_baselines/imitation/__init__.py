"""Learning from a teacher who knows the payload: plans by convex programmes, imitated."""

from drm_baselines.support.extras import require

require("imitation", "learn", "clarabel", "piqp", "scipy", "torch")
