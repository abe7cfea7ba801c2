"""The benchmark's records as tables, targets, figures and one HTML page."""

from drm_baselines.support.extras import require

require("the report of the benchmark", "report")
